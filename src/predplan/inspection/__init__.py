"""What each artifact looks like: recordings for the Rerun viewer, a page and a layout for each kind.

The viewer's library is imported when a recording is made, not with this package.
"""

from __future__ import annotations

from pathlib import Path


def show(artifact: Path, save: Path | None = None) -> Path | None:
    """Open the viewer on an artifact and wait until it is closed; with save, write the recording there instead.

    An .rrd file is opened as it is, and so is an .mcap file that holds neither a plan nor rollouts. Returns save.
    Raises InputError for what is no artifact of predplan, PredplanError where the viewer does not start.
    """
    from predplan.inspection import pages, recording

    if save is not None:
        pages.record(artifact, save)
    else:
        with pages.viewable(artifact) as file:
            recording.open_viewer(file)
    return save


def record(artifact: Path, out: Path) -> None:
    """Write the recording of an artifact, whole. Raises InputError for what is no artifact of predplan."""
    from predplan.inspection import pages

    pages.record(artifact, out)
