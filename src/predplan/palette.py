"""One colour a method, in every figure and every recording; readable with any colour vision, on light and on dark.

Hues are Okabe and Ito's (2008), whose neighbours stay apart for red-green and blue-yellow blindness; shades of one hue
are variants of one idea. No figure tells methods apart by colour alone: lines carry their names.
"""

from __future__ import annotations

GREY, LIGHT_GREY, SLATE = "#8c8c8c", "#a6a6a6", "#6f7f96"
ORANGE, AMBER = "#e69f00", "#c48a12"
GREEN, DEEP_GREEN = "#12a37a", "#0e8a68"
BLUE, SKY, DEEP_BLUE = "#3b9ede", "#7cc0ea", "#1f72b8"
VERMILLION, ROSE = "#d55e00", "#cc79a7"

BROWN, YELLOW, DEEP_ROSE = "#8c5a2b", "#bfa500", "#a3447b"

METHOD_COLOURS = {
    "supervised-addone": LIGHT_GREY,
    "supervised": GREY,
    "supervised-fhmm": SLATE,
    "em": ORANGE,
    "em-fhmm": AMBER,
    "self-training": GREEN,
    "self-training-fhmm": DEEP_GREEN,
    "anchor-lambda0": SKY,
    "anchor-lambda1": SKY,
    "anchor-kl-lambda0": SKY,
    "anchor-kl-lambda1": SKY,
    "anchor-literal-lambda0": DEEP_BLUE,
    "anchor-literal-lambda1": DEEP_BLUE,
    "anchor-fhmm-lambda0": DEEP_BLUE,
    "anchor-fhmm-lambda1": DEEP_BLUE,
    "anchor-composite-lambda0": DEEP_BLUE,
    "anchor-composite-lambda1": DEEP_BLUE,
    "anchor": BLUE,
    "anchor-fhmm": DEEP_BLUE,
    "crf": ROSE,
    "crf-clusters": ROSE,
    "crf-all": ROSE,
    "crf-all-clusters": ROSE,
    "crf-posteriors": VERMILLION,
    "crf-clusters-posteriors": VERMILLION,
    "crf-all-posteriors": VERMILLION,
    "crf-all-clusters-posteriors": VERMILLION,
    "grbf": VERMILLION,
    "grbf-narrow": ROSE,
    "grbf-narrow-large": ROSE,
    "grbf-middle": ROSE,
    "grbf-body": DEEP_ROSE,
    "grbf-der": YELLOW,
    "grbf-jj": ORANGE,
    "grbf-waypoints": DEEP_ROSE,
    "grbf-narrow-waypoints": DEEP_ROSE,
    "grbf-quadrature": SLATE,
    "grbf-narrow-quadrature": SLATE,
    "laplacian": GREEN,
    "laplacian-narrow": GREEN,
    "b-spline": BROWN,
    "b-spline-narrow": BROWN,
    "waypoints-velocity": SKY,
    "waypoints-velocity-large": SKY,
    "waypoints-acceleration": DEEP_BLUE,
    "waypoints-acceleration-large": DEEP_BLUE,
    "waypoints-few": GREY,
    "chomp-velocity": BLUE,
    "chomp-acceleration": DEEP_BLUE,
    "chomp-path": SLATE,
    "rpsp": BLUE,
    "rpsp-obs": DEEP_BLUE,
    "rpsp-trpo": SLATE,
    "rpsp-vrpg": ROSE,
    "rpsp-alt": DEEP_ROSE,
    "rpsp-frozen": SKY,
    "rpsp-unrefined": SLATE,
    "rpsp-reactive": BROWN,
    "rpsp-random": GREY,
    "fm1": YELLOW,
    "fm2": ORANGE,
    "fm2-trpo": AMBER,
    "fm5": AMBER,
    "fm10": VERMILLION,
    "gru": GREEN,
    "gru-16": GREEN,
    "gru-64": GREEN,
    "gru-128": GREEN,
    "gru-trpo": DEEP_GREEN,
    "gru-predictive": DEEP_GREEN,
    "last": LIGHT_GREY,
    "order 1": YELLOW,
    "order 2": ORANGE,
    "order 5": AMBER,
    "order 10": VERMILLION,
    "order 20": BROWN,
    "kernel": ROSE,
    "innovation": SKY,
    "innovation refined": BLUE,
    "innovation corrected": DEEP_BLUE,
}

MISTAKE = VERMILLION
"""A wrong tag, a wrong turn."""
RIGHT = GREEN
"""A right tag; only beside MISTAKE, and never without a sign of its own."""


def colour_of(method: str) -> str:
    """The colour of a method; grey for one that has none."""
    return METHOD_COLOURS.get(method, GREY)
