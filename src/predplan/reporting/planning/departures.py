"""What differs from the thesis's chapter 4, and why."""

from __future__ import annotations

DEPARTURES: tuple[tuple[str, str], ...] = (
    (
        "Kernels.",
        "exp(+d²/2σ²), as Eqs. 4.2, 4.6 and 4.7 print it, is not a kernel: exp(−d²/2σ²) is used. The first derivative "
        "of a kernel by one argument is antisymmetric and no kernel either; “GRBF-der” is k + σ² ∂∂'k, whose weight "
        "the thesis leaves open.",
    ),
    (
        "Ends.",
        "The multipliers of Eqs. 4.16 to 4.18 leave an error at the ends as printed. Kernels are conditioned on both "
        "ends once, and then the ends hold exactly whatever is added.",
    ),
    (
        "Shrinkage.",
        "Eq. 4.12 shrinks the whole trajectory by 1 − β/λ, the straight line too, which is not in a Gaussian space. "
        "Here a trajectory is the line plus an element of the space, and only that shrinks, by one share for all "
        "methods; the thesis’s β = 1 with λ = 40 is that share.",
    ),
    (
        "Coupled joints.",
        "JᵀJ has rank 3 for seven joints, and a trajectory could not reach most configurations: JᵀJ + εI, with its "
        "trace scaled to the number of joints.",
    ),
    (
        "Joint limits and self-collision.",
        "Limits are inequalities that an active set meets (Eq. 4.19 does not enforce μ ≥ 0); the descent sees links "
        "that near each other where it sums over the body, and the certificate always tries both.",
    ),
    (
        "Scenes.",
        "The thesis’s are not published. Problems are drawn by seed, with start and goal clear of obstacles, a "
        "straight line that collides, and a way around that a sampling planner has found (in the maze "
        "by construction). The planar arm starts and ends bent, and discs stand where its end passes: stretched it is "
        "singular, and no gradient folds it. The kitchen is that of gymnasium-robotics, its arm covered by spheres.",
    ),
    (
        "Quadrature.",
        "Gauss-Legendre nodes are for [−1, 1]: t = (x + 1)/2, and weights are halved.",
    ),
)
