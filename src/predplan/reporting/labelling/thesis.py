"""Numbers of the thesis (section 3.6), each with the table or the paragraph it stands in."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

Source = Literal["twitter", "malagasy", "malagasy with dictionary"]

TABLE_3_1: Mapping[str, Mapping[int, float]] = {
    "supervised-addone": {150: 71.7, 1000: 81.1},
    "em": {150: 77.2, 1000: 83.1},
    "self-training": {150: 78.2, 1000: 86.1},
    "anchor-lambda0": {150: 83.0, 1000: 85.5},
    "anchor-lambda1": {150: 84.3, 1000: 88.0},
    "supervised-fhmm": {150: 81.8, 1000: 89.1},
    "em-fhmm": {150: 81.8, 1000: 89.1},
    "self-training-fhmm": {150: 83.4, 1000: 89.4},
    "anchor-fhmm-lambda0": {150: 84.1, 1000: 86.7},
    "anchor-fhmm-lambda1": {150: 85.3, 1000: 89.1},
}
"""Accuracy, %, on Twitter by labelled tweets: baselines and anchor models."""

TABLE_3_2: Mapping[str, Mapping[int, float]] = {
    "anchor-fhmm-lambda1": {150: 85.3, 1000: 89.1},
    "anchor-composite-lambda1": {150: 79.3, 1000: 85.5},
    "anchor-composite-lambda0": {150: 77.6, 1000: 84.0},
}
"""Accuracy, %, on Twitter: transitions by counts and by composite likelihood."""

TABLE_3_3: Mapping[str, Mapping[int, float]] = {
    "crf-clusters": {150: 89.57, 1000: 93.36},
    "crf-clusters-posteriors": {150: 91.14, 1000: 93.18},
    "crf-all-clusters": {150: 91.55, 1000: 94.17},
    "crf-all-clusters-posteriors": {150: 92.06, 1000: 94.11},
}
"""Accuracy, %, on Twitter: stacked taggers, there a MEMM, here a CRF."""

TABLE_3_4: Mapping[str, Mapping[Source, float]] = {
    "supervised-fhmm": {"malagasy": 90.5},
    "em-fhmm": {"malagasy": 90.5},
    "self-training-fhmm": {"malagasy": 88.7},
    "anchor-fhmm-lambda1": {"malagasy": 89.4, "malagasy with dictionary": 90.9},
}
"""Accuracy, %, on Malagasy, 176 labelled sentences: tokens alone, and with the dictionary of types."""

TRAINING_HOURS: Mapping[str, float] = {
    "anchor-fhmm-lambda1": 3.8,
    "anchor-composite-lambda1": 4.0,
    "self-training": 10.3,
    "em": 14.9,
    "crf-all-clusters": 42.0,
}
"""Hours of training on Twitter with 2.7 million raw tweets (Runtime comparison)."""
