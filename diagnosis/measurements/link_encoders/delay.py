"""The delay of link encoders behind motor encoders: of each joint alone, and as the evidence of a cause."""

from __future__ import annotations

import numpy as np

from arm_io.types import Array
from diagnosis.measurements.link_encoders.candidates import late
from diagnosis.measurements.link_encoders.model import Chosen, LinkEncoders


def delays_by_joint(others: Chosen, model: LinkEncoders) -> Array:
    """(k,) s: the delay estimated from each joint alone, conditional on the other causes."""
    delays = []
    for k, joint in enumerate(int(j) for j in model.whole.joints):
        own = [s for s in others if s.joint in (None, joint)]
        x = np.column_stack([np.ones(model.whole.rows), *(model.columns(s, model.whole, k) for s in [*own, late()])])
        delays.append(float(np.linalg.lstsq(x, model.whole.difference[:, k], rcond=1e-10)[0][-1]))
    return np.array(delays)


def delay_sentence(others: Chosen, model: LinkEncoders) -> str:
    """Evidence of a delay: that of every joint, what it predicts, and what other effects would predict instead."""
    delays = delays_by_joint(others, model)
    whole = model.residual(others, model.rows.fit, model.rows.held_out)
    residual = model.residual([*others, late()], model.rows.fit, model.rows.held_out)
    shares = 1.0 - np.sum(residual**2, axis=0) / np.sum(whole**2, axis=0)
    where = ", ".join(map(str, model.rows.fit.joints))
    low, high = float(shares.min()), float(shares.max())
    share = f"{low:.1%}" if len(shares) == 1 else f"{low:.1%} to {high:.1%}"
    sentence = (
        f"motor minus link encoder is proportional to velocity, {', '.join(f'{d * 1e3:.2f}' for d in delays)} ms "
        f"at joint {where}, which predicts {share} of its square in held-out rows: the link encoder is stamped late"
    )
    instead = _best_instead(others, model)
    return sentence + (f"; {instead}" if instead else "")


def _best_instead(others: Chosen, model: LinkEncoders) -> str:
    """Largest share that the effects confused with a delay would predict in its place, at any joint."""
    best: dict[str, float] = {}
    taken_for = late().definition.confused_with
    for candidate in model.best(others):
        if candidate.effect in taken_for and model.is_physical(candidate, others):
            best[candidate.effect] = max(best.get(candidate.effect, 0.0), model.score(candidate, others).share)
    return " and ".join(f"{name.replace('_', ' ')} would predict at most {share:.0%}" for name, share in best.items())
