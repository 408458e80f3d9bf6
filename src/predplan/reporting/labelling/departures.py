"""What differs from the thesis's chapter 3, and why."""

from __future__ import annotations

DEPARTURES: tuple[tuple[str, str], ...] = (
    (
        "Unknown words.",
        "The thesis does not say how its baselines treat words they never saw labelled; its supervised HMM is matched "
        "by adding one to every count. Here every baseline but that one judges an unknown word by its spelling; what "
        "that alone is worth is the difference of the first two rows of Table 3.1. The gain that is left over such "
        "baselines is the anchors' own.",
    ),
    (
        "Loss.",
        "Context distributions are mixtures, so the fit by Kullback-Leibler divergence (the other loss of Arora et al. "
        "2013) is our default; the least squares of Eq. 3.15 is kept as the thesis's. Contexts are the neighbouring "
        "words themselves, scaled by the inverse root of their frequency; the CCA of section 3.5 is a choice, and the "
        "ablations say what it costs.",
    ),
    (
        "λ = 1 for words without labels.",
        "Eq. 3.27 gives nothing for them. Words seen labelled take their labelled posterior, all others that of the "
        "contexts; the constraint γ ≥ 0 stays. Our own models weigh the two by how much each is worth on held-out "
        "labels instead.",
    ),
    (
        "Feature HMM at λ = 1.",
        "Fitted feature by feature, mean parameters need not be those of any distribution (the features that share a "
        "word contradict each other) and the weights grow without bound. They are composed from the words' posteriors "
        "instead, μ_h = Σ φ(x) p_x γ_xh / Σ p_x γ_xh, which always is one.",
    ),
    (
        "Regulariser of the feature HMM.",
        "With the sign printed in Eq. 3.26 and Algorithm 6 the maximum is unbounded, and the norm as printed has no "
        "gradient at zero: we subtract ε/2 ‖θ‖².",
    ),
    (
        "Shapes and indices.",
        "Q has a row a word and R a row a tag, as Eqs. 3.3 and 3.10 need and Algorithm 3 and Eq. 3.19 contradict; "
        "γ carries a word and a tag where Eq. 3.16 prints a word and a context.",
    ),
    (
        "Composite likelihood.",
        "In Algorithm 4 the second factor of the pair's posterior is that of the second word, O(x_j, h'), and the "
        "M-step adds up over pairs. The likelihood then never falls, which a test asserts.",
    ),
    (
        "Start and stop.",
        "The transition matrix has different sizes in different places of the thesis. Here: a row for each previous "
        "tag and one for the start, a column for each next tag and one for the stop; no empty sentence; one added to "
        "each count; rows, the stop among them, sum to one.",
    ),
    (
        "Word features under CCA.",
        "Projected features may be negative, and then γ ≥ 0 no longer follows. Only contexts are projected.",
    ),
    (
        "Anchor thresholds.",
        "More than 500 raw and at least four labelled occurrences leave tags without any anchor at 150 sentences. "
        "The labelled count, then the raw count, then the purity give way until each tag has one.",
    ),
    (
        "Tests.",
        "A Kolmogorov-Smirnov test compares distributions of two independent samples of a continuous quantity; on "
        "right and wrong words it has many ties and ignores that both taggers met the same words. It is given because "
        "the thesis gives it; McNemar's test and intervals from sentences drawn anew stand beside it.",
    ),
    (
        "Stacked tagger.",
        "The thesis adds posteriors to the MEMM of Owoputi et al. (2013). Here they are added to a CRF with the "
        "feature HMM’s features of words and their neighbours; clusters are learned from our own raw text, and joined "
        "on Twitter by the published ones of that tagger; all features are those and that tagger’s tag dictionary.",
    ),
    (
        "EM for the feature HMM.",
        "The thesis reports its first iteration, which is the supervised model, since none did better on dev. The "
        "iteration here is chosen on dev as well.",
    ),
    (
        "Data.",
        "The thesis's 2.7 million raw tweets may not be passed on; each corpus’s section says which raw text was used. "
        "The published development part of Oct27 has 327 tweets, not 328.",
    ),
)
