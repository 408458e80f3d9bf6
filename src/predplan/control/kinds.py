"""The names of the ways to learn a policy; `methods` says what each is."""

from __future__ import annotations

from typing import Literal

MethodName = Literal[
    "rpsp",
    "rpsp-obs",
    "rpsp-trpo",
    "rpsp-alt",
    "rpsp-vrpg",
    "rpsp-reactive",
    "rpsp-frozen",
    "rpsp-random",
    "fm1",
    "fm2",
    "fm5",
    "fm10",
    "fm2-trpo",
    "gru",
    "gru-16",
    "gru-64",
    "gru-128",
    "gru-predictive",
    "gru-trpo",
]
