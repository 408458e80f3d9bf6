"""The report on labelling: chapter 3's tables and figure, rebuilt beside the thesis's numbers."""
