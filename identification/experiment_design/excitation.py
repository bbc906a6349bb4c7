"""The motion that shows an arm's parameters best, inside its limits, as an experiment that ``record`` runs.

A finite Fourier series for each joint (Swevers et al., IEEE T-RA 13(5), 1997) about a pose that is searched with it.
Whatever the search proposes is scaled into the limits (``feasible``), so that every candidate can be run, and judged by
one of two criteria (``criterion``). Effects of the model count with the parameters in which they are linear.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from arm_model import Arm
from experiment import Experiment
from identification.experiment_design.criterion import Criterion, score_in_words, scores_of
from identification.experiment_design.feasible import Task, checked, drawn, feasible, none_found
from identification.experiment_design.fourier_series import Series, Shapes
from identification.experiment_design.limits import Limits
from identification.regression.base_parameters import structural_base

Progress = Callable[[float, str], None]

TWENTY_SECONDS = Series()
ROUNDED = 1e-5
"""Share of a column: a smaller remainder comes from rounded angles in the file (1.5708)."""
TOGETHER = 16
"""Candidates judged at a time."""
ROWS = 160
"""Instants at which a candidate is judged."""


def design_excitation(
    arm: Arm,
    series: Series = TWENTY_SECONDS,
    *,
    criterion: Criterion = "d",
    limits: Limits | None = None,
    candidates: int = 1600,
    seed: int = 1,
    progress: Progress = lambda _share, _text: None,
) -> Experiment:
    """The best of ``candidates`` motions: random ones first, then steps from the best that shrink when they fail.

    The same seed gives the same motion. ``progress`` is called with the share done and the best score so far, in words.
    InputError where no motion keeps clear of what ``limits.pairs`` names, and where the limits of torque do not let the
    arm move.
    """
    limits = limits or Limits.of(arm)
    base = structural_base(arm, negligible=ROUNDED)
    random = np.random.default_rng(seed)
    # sixty a period of the fastest harmonic, fades included
    rows = int(60 * (series.harmonics * series.fundamental * series.duration + 4))
    task, judged = Task(arm, limits, series, Shapes.of(series, rows)), Shapes.of(series, ROWS)
    best, best_score, step = drawn(task, random), -np.inf, 0.5
    generations = max(2, candidates // TOGETHER)
    for generation in range(generations):
        if generation < generations // 5:
            trials = [drawn(task, random) for _ in range(TOGETHER)]
        else:
            steps = step * random.standard_normal((TOGETHER, *best.shape))
            trials = list(best + steps * (random.random(steps.shape) < 0.3))
        start, weights, clear = feasible(task, np.stack(trials))
        scores = np.full(len(trials), -np.inf)
        if clear.any():
            motions = judged.motions(start[clear], weights[clear])
            scores[clear] = scores_of(arm, base, judged.t, motions, limits, criterion)
        winner = int(np.argmax(scores))
        if scores[winner] > best_score:
            best, best_score = trials[winner], float(scores[winner])
            step = min(1.2 * step, 1.0)
        elif generation >= generations // 5:
            step = max(0.9 * step, 0.02)
        progress(generation / generations, f"{criterion} {score_in_words(best_score, criterion)}")
    if not np.isfinite(best_score):
        raise none_found(task)
    return checked(task, best)
