"""What differs from the thesis's chapter 5, and why."""

from __future__ import annotations

DEPARTURES: tuple[tuple[str, str], ...] = (
    (
        "The filter.",
        "The thesis conditions on random Fourier features by kernel Bayes’ rule; that filter is here too, and where "
        "features are tabular it is Bayes’ rule. The one that policies use is linear and in innovation form, learned "
        "by the same two stages: its update cannot be singular, its gradients stay small through whole episodes, and "
        "these mechanisms’ positions are nearly linear in those before, which random features tell with an error.",
    ),
    (
        "Conditioning.",
        "Eq. 2.72 writes a contraction as a Kronecker product and has no regulariser. C(a) is the state contracted "
        "with the action’s features, and (CᵀC + λI)⁻¹ C is applied by a Cholesky solve: an estimated C(a) is not "
        "positive definite, and Eq. 2.77’s C + λI need not be either; its order of products does not fit the shapes.",
    ),
    (
        "Extension.",
        "Eqs. 2.73 to 2.75 and their text run in opposite directions, and use two different action features. The "
        "extended state is W_ext q, by two maps, one for the extended futures and one for the immediate observation; "
        "the feature of §2.5.6 has F·O·O + O·O numbers, not (F·O + O) × 2O.",
    ),
    (
        "Prediction.",
        "W_pred acts on q ⊗ φ(a) in one place, on q ⊗ a in another, on q in a third. With raw actions, a = 0 would "
        "foretell 0. The kernel filter takes features of actions, the linear one is affine in q and a.",
    ),
    (
        "Time.",
        "Actions of Algorithm 8 follow observations that its filter has not taken yet, and a₀ is undefined. Here a "
        "step is an action, then the observation it led to; the reset is step 0 with action 0, in acting and in "
        "learning alike.",
    ),
    (
        "Exploration of policies.",
        "σ = exp(r²) (Eq. 5.6) is never below 1 and has no gradient at r = 0. σ = exp(r).",
    ),
    (
        "The joint loss.",
        "Eqs. 5.7, 5.10 and Algorithm 9 divide by the gradients’ sizes twice and lose the sign of the return’s. Each "
        "part is divided once, by the root of the running mean of its squared norm, corrected for its start; −J is "
        "minimised.",
    ),
    (
        "Alternating updates.",
        "Line 2 of Algorithm 10 also moves the reactive policy and line 5 moves the filter in a direction of other "
        "parameters. Here the policy’s step is taken on the old states, the filter’s steps follow, and the policy is "
        "then fitted to do on the new states what it did on the old ones; without that, runs collapse.",
    ),
    (
        "The main update.",
        "PPO in minibatches of batches of a few thousand steps for every method, instead of TRPO on 10,000, which "
        "needs more steps. TRPO, the joint and the alternating update are there for comparison. The filter is "
        "refitted by regression on the policy’s own steps, and a refit that would move the policy by too much is "
        "rejected.",
    ),
    (
        "Copies out of step.",
        "Where nothing but the horizon ends episodes (Swimmer), the copies that a method samples side by side set off "
        "at different ages. In step, each batch would show one part of an episode alone; every method then had runs "
        "that got stuck.",
    ),
    (
        "Inputs of baselines.",
        "Whitened, as states are. It makes finite memories learn as fast as the filter where positions are exact; "
        "unwhitened ones, as in the thesis, would lose for a reason that is not their memory.",
    ),
    (
        "Counting.",
        "“100 trajectories equal 10 iterations” (§5.8) is wrong where episodes end early: true steps are counted, the "
        "exploration’s included, and it is part of every curve and mean.",
    ),
    (
        "Numbers.",
        "The thesis’s table of areas under curves is missing (“Table ??”), its AUC lacks the division by the number "
        "of steps, and which windows are best is told in two ways. The first table here is that table, as mean return "
        "over training.",
    ),
    (
        "Rewards.",
        "Gymnasium’s version 5 rewards and ends, with the thesis’s horizons. Most of the settings published with the "
        "paper replace Hopper’s reward, so returns there cannot be compared with these.",
    ),
)

LIMITATIONS: tuple[tuple[str, str], ...] = (
    (
        "The best baseline is chosen afterwards.",
        "That favours it: a fixed baseline would do no better.",
    ),
    (
        "Settings.",
        "One setting of each method for all tasks, chosen on these tasks. The thesis’s are tuned task by task.",
    ),
    (
        "Tasks.",
        "Simulated mechanisms whose last positions tell their velocities: a linear filter suits them. “CartPole” is "
        "InvertedPendulum, as in the thesis. Nothing is said of images, contacts that cannot be felt, or real robots.",
    ),
    (
        "Noise.",
        "Gaussian, independent from step to step, in units of each position’s spread while exploring; losses are "
        "independent too. Sensors often fail for longer.",
    ),
    (
        "Returns while learning",
        "are those of the policy as it explores; without its exploration noise it is worth more.",
    ),
)
