"""The methods the experiments compare, by name, and the anchor models among them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from predplan.labelling.anchors import tag_matrix
from predplan.labelling.decoding import Transitions
from predplan.labelling.lexicon import Lexicon, Supervision
from predplan.labelling.loglinear import fit_emissions, literal_mean_parameters
from predplan.labelling.models import FeatureHiddenMarkovModel, HiddenMarkovModel, SequenceModel
from predplan.labelling.moments import context_label_moments
from predplan.labelling.posteriors import Loss, PosteriorSettings, context_posteriors
from predplan.labelling.supervised import Indifference, TableHiddenMarkovModel
from predplan.labelling.training import RawStatistics, TrainingSettings, emission_features, train_feature_model

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Method:
    """How a method is called in tables, and the family it belongs to."""

    label: str
    family: Literal["supervised", "semi-supervised", "anchor (thesis)", "anchor", "field"]


UNTIMED = ("anchor-composite-lambda0", "anchor-composite-lambda1")
"""Methods whose transitions the stage before fitted: what is left of their training says nothing."""

LITERAL_PENALTY = 1e-2
"""A program a feature gives means that no distribution has, so the weights need a firmer hand."""

METHODS = {
    "supervised-addone": Method("supervised HMM, add-one", "supervised"),
    "supervised": Method("supervised HMM", "supervised"),
    "supervised-fhmm": Method("supervised FHMM", "supervised"),
    "em": Method("EM HMM", "semi-supervised"),
    "em-fhmm": Method("EM FHMM", "semi-supervised"),
    "self-training": Method("self-training HMM", "semi-supervised"),
    "self-training-fhmm": Method("self-training FHMM", "semi-supervised"),
    "anchor-lambda0": Method("anchor HMM, least squares, λ=0", "anchor (thesis)"),
    "anchor-lambda1": Method("anchor HMM, least squares, λ=1", "anchor (thesis)"),
    "anchor-kl-lambda0": Method("anchor HMM, KL, λ=0", "anchor (thesis)"),
    "anchor-kl-lambda1": Method("anchor HMM, KL, λ=1", "anchor (thesis)"),
    "anchor-literal-lambda0": Method("anchor FHMM, a program a feature, λ=0", "anchor (thesis)"),
    "anchor-literal-lambda1": Method("anchor FHMM, a program a feature, λ=1", "anchor (thesis)"),
    "anchor-fhmm-lambda0": Method("anchor FHMM, λ=0", "anchor (thesis)"),
    "anchor-fhmm-lambda1": Method("anchor FHMM, λ=1", "anchor (thesis)"),
    "anchor-composite-lambda0": Method("anchor FHMM, λ=0, composite likelihood", "anchor (thesis)"),
    "anchor-composite-lambda1": Method("anchor FHMM, λ=1, composite likelihood", "anchor (thesis)"),
    "anchor": Method("anchor HMM, calibrated", "anchor"),
    "anchor-fhmm": Method("anchor FHMM, calibrated", "anchor"),
    "crf": Method("CRF", "field"),
    "crf-clusters": Method("CRF + clusters", "field"),
    "crf-posteriors": Method("CRF + posteriors", "field"),
    "crf-clusters-posteriors": Method("CRF + clusters + posteriors", "field"),
    "crf-all": Method("CRF, all features", "field"),
    "crf-all-clusters": Method("CRF, all features + clusters", "field"),
    "crf-all-posteriors": Method("CRF, all features + posteriors", "field"),
    "crf-all-clusters-posteriors": Method("CRF, all features + clusters + posteriors", "field"),
}


@dataclass(frozen=True)
class AnchorInputs:
    """What the anchor models of one training set are made from; anchors [V, K]."""

    raw: RawStatistics
    tags: tuple[str, ...]
    supervision: Supervision
    anchors: NDArray[np.bool_]
    lexicon: Lexicon
    counted: Transitions
    composite: Transitions
    settings: TrainingSettings


def anchor_models(inputs: AnchorInputs) -> Iterator[tuple[str, SequenceModel]]:
    """The thesis's anchor models at λ = 0 and 1, and ours on calibrated posteriors, by name."""
    labelled = tag_matrix(inputs.supervision.labels, inputs.raw.word_ids, inputs.tags)
    losses: tuple[tuple[Loss, str], ...] = (("ls", "anchor-lambda"), ("kl", "anchor-kl-lambda"))
    for loss, prefix in losses:
        fitting = replace(inputs.settings.posteriors, loss=loss)
        for lam in (0, 1):
            gamma = thesis_posteriors(inputs, fitting, labelled, lam)
            yield f"{prefix}{lam}", thesis_model(inputs.raw, gamma, inputs.counted)
            if loss == "ls":
                yield f"anchor-literal-lambda{lam}", literal_feature_model(inputs, labelled, lam)
            if loss == "kl":
                featured = thesis_feature_model(inputs, gamma)
                yield f"anchor-fhmm-lambda{lam}", featured
                yield f"anchor-composite-lambda{lam}", replace(featured, transitions=inputs.composite)
    yield "anchor", HiddenMarkovModel(inputs.lexicon, inputs.counted)
    lexicon = inputs.lexicon
    words, probabilities = list(lexicon.word_ids), lexicon.probabilities
    yield "anchor-fhmm", train_feature_model(words, lexicon.count, probabilities, inputs.counted, inputs.settings)


def thesis_posteriors(inputs: AnchorInputs, fitting: PosteriorSettings, labelled: Floats, lam: int) -> Floats:
    """gamma [V, K] by Eq. 3.27; anchors stand for their tags alone, except where labels decide (λ = 1)."""
    gamma = context_posteriors(inputs.raw.moments, inputs.anchors, fitting, labelled, float(lam)).gamma
    fixed = inputs.anchors.any(axis=1) & ((labelled.sum(axis=1) == 0) | (lam == 0))
    gamma[fixed] = inputs.anchors[fixed] / inputs.anchors[fixed].sum(axis=1, keepdims=True)
    return gamma


def thesis_model(raw: RawStatistics, gamma: Floats, transitions: Transitions) -> TableHiddenMarkovModel:
    """Emissions by Bayes' rule (Eq. 3.16); an unknown word is like the rare words of the raw text."""
    joint = gamma * raw.moments.word_probability[:, None]
    tag_probability = np.maximum(joint.sum(axis=0), 1e-6)
    rare = gamma[raw.moments.word_count <= 1] if (raw.moments.word_count <= 1).any() else gamma
    return TableHiddenMarkovModel(
        raw.word_ids,
        joint / tag_probability + 1e-12,
        tag_probability,
        Indifference(rare.mean(axis=0)),
        transitions,
    )


def thesis_feature_model(inputs: AnchorInputs, gamma: Floats) -> FeatureHiddenMarkovModel:
    """Log-linear emissions on mean parameters composed from gamma (Algorithm 5)."""
    moments = inputs.raw.moments
    kept = np.flatnonzero(moments.word_count >= inputs.settings.lexicon.least_count)
    words = [moments.vocabulary[word] for word in kept.tolist()]
    return train_feature_model(words, moments.word_count[kept], gamma[kept] + 1e-6, inputs.counted, inputs.settings)


def literal_feature_model(inputs: AnchorInputs, labelled: Floats, lam: int) -> FeatureHiddenMarkovModel:
    """Log-linear emissions on mean parameters by one quadratic program a feature (Algorithm 5 as printed)."""
    moments, settings = inputs.raw.moments, inputs.settings
    columns, features = emission_features(moments.vocabulary, moments.word_count, settings.emission_count)
    contexts = context_label_moments(moments, inputs.anchors, settings.posteriors.smoothing)
    mean = literal_mean_parameters(features, moments, contexts, labelled, float(lam))
    return FeatureHiddenMarkovModel(columns, fit_emissions(features, mean, LITERAL_PENALTY), inputs.counted)
