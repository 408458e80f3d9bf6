"""Motion planning in reproducing kernel Hilbert spaces: from an arm, a scene, a start and a goal to a certified trajectory."""
