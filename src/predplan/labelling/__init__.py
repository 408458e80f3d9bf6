"""Sequence labelling with the method of moments and anchor words (chapter 3)."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from predplan.labelling.readers import read_dictionary, read_labelled, read_raw
    from predplan.labelling.tagger import AnchorTagger

__all__ = ["AnchorTagger", "read_dictionary", "read_labelled", "read_raw"]

_HOMES = {"AnchorTagger": "tagger", "read_dictionary": "readers", "read_labelled": "readers", "read_raw": "readers"}


def __getattr__(name: str) -> Any:
    """Names are found when they are asked for, so that importing one module does not load them all."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
