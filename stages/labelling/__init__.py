"""The labelling branch: corpus, tokenise, moments, anchors, emissions, transitions, tag, baselines, stack, evaluate."""
