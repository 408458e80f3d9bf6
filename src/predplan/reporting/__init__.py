"""Reports: from tables to figures, Markdown and one page of HTML; pure functions that know no files."""
