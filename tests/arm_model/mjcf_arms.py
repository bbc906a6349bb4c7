"""Random serial arms as MJCF texts: every way to say an orientation and an inertia, and MuJoCo's inverse dynamics."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

Array = np.ndarray


def text_of(values: Array) -> str:
    return " ".join(repr(float(value)) for value in np.atleast_1d(values))


def orientation(rng: np.random.Generator, angle: float) -> str:
    """An orientation attribute; ``angle``: units of the file per rad."""
    kind = rng.integers(6)
    if kind == 0:
        return f'quat="{text_of(rng.normal(size=4))}"'
    if kind == 1:
        return f'axisangle="{text_of(rng.normal(size=3))} {rng.uniform(-3, 3) * angle!r}"'
    if kind == 2:
        return f'xyaxes="{text_of(rng.normal(size=6))}"'
    if kind == 3:
        return f'zaxis="{text_of(rng.normal(size=3))}"'
    return f'euler="{text_of(rng.uniform(-3, 3, 3) * angle)}"' if kind == 4 else ""


def inertial(rng: np.random.Generator, angle: float) -> str:
    """An <inertial> of a physical body, as a full or a diagonal tensor."""
    points = rng.normal(size=(8, 3)) * 0.1
    second = points.T @ points
    tensor = np.trace(second) * np.eye(3) - second
    head = f'<inertial pos="{text_of(rng.normal(size=3) * 0.1)}" mass="{rng.uniform(0.5, 4)!r}"'
    if rng.random() < 0.5:
        places = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
        return f'{head} fullinertia="{text_of(np.array([tensor[place] for place in places]))}"/>'
    return f'{head} diaginertia="{text_of(np.linalg.eigvalsh(tensor))}" {orientation(rng, angle)}/>'


def geom(rng: np.random.Generator, angle: float) -> str:
    """A <geom> with a mass."""
    kind = str(rng.choice(["sphere", "capsule", "cylinder", "box", "ellipsoid"]))
    count = {"sphere": 1, "capsule": 2, "cylinder": 2}.get(kind, 3)
    how = f'mass="{rng.uniform(0.1, 2)!r}"' if rng.random() < 0.5 else f'density="{rng.uniform(500, 3000)!r}"'
    if kind != "sphere" and rng.random() < 0.4:
        size, ends = rng.uniform(0.02, 0.08), text_of(rng.normal(size=6) * 0.2)
        return f'<geom type="{kind}" size="{size!r}" fromto="{ends}" {how}/>'
    size, place = text_of(rng.uniform(0.02, 0.1, count)), text_of(rng.normal(size=3) * 0.1)
    return f'<geom type="{kind}" size="{size}" pos="{place}" {orientation(rng, angle)} {how}/>'


def mjcf(seed: int) -> str:
    """An arm of 2 to 5 bodies, some with two joints, some with fixed bodies."""
    rng = np.random.default_rng(seed)
    radian = rng.random() < 0.5
    angle = 1.0 if radian else 180 / np.pi
    order = "".join(letter.upper() if rng.random() < 0.5 else letter for letter in rng.permutation(list("xyz")))
    compiler = f'<compiler eulerseq="{order}"' + (' angle="radian"/>' if radian else "/>")
    body, number = "", 0
    for depth in reversed(range(int(rng.integers(2, 6)))):
        parts = [inertial(rng, angle) if rng.random() < 0.5 else geom(rng, angle) + geom(rng, angle)]
        for _ in range(int(rng.integers(1, 3))):
            slide, number = rng.random() < 0.3, number + 1
            attributes = [f'name="j{number}"', f'axis="{text_of(rng.normal(size=3))}"', 'type="slide"' if slide else ""]
            attributes += [f'pos="{text_of(rng.normal(size=3) * 0.2)}"'] * (rng.random() < 0.6)
            attributes += [f'ref="{rng.uniform(-1, 1) * (1.0 if slide else angle)!r}"'] * (rng.random() < 0.3)
            attributes += [f'damping="{rng.uniform(0, 3)!r}"'] * (rng.random() < 0.5)
            attributes += ['class="light"'] * (rng.random() < 0.3)
            parts.append(f"<joint {' '.join(attributes)}/>")
        if rng.random() < 0.5:
            place = text_of(rng.normal(size=3) * 0.1)
            parts.append(
                f'<body name="cap{depth}" pos="{place}" {orientation(rng, angle)}>{inertial(rng, angle)}</body>'
            )
        holds = 'childclass="heavy"' if rng.random() < 0.3 else ""
        place = text_of(rng.normal(size=3) * 0.3)
        body = f'<body name="b{depth}" pos="{place}" {orientation(rng, angle)} {holds}>{"".join(parts)}{body}</body>'
    defaults = (
        '<default><joint armature="0.02" damping="0.4"/><default class="heavy"><joint armature="0.3"/></default>'
        '<default class="light"><joint damping="0.1" frictionloss="0.2"/></default></default>'
    )
    gravity = f'<option gravity="{text_of(rng.normal(size=3) * 5)}"/>'
    return f'<mujoco model="random">{compiler}{gravity}{defaults}<worldbody>{body}</worldbody></mujoco>'


def torque(path: Path, joints: list[str], q: Array, speed: Array, acceleration: Array) -> Array:
    """(N, n) N m (N) of the joints by MuJoCo, without dry friction, limits and contacts."""
    model = mujoco.MjModel.from_xml_path(str(path))
    flags = mujoco.mjtDisableBit
    model.opt.disableflags |= int(flags.mjDSBL_CONSTRAINT)
    data = mujoco.MjData(model)
    numbers = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name) for name in joints]
    places, dofs = model.jnt_qposadr[numbers], model.jnt_dofadr[numbers]
    found = []
    for one in zip(q, speed, acceleration):
        mujoco.mj_resetData(model, data)
        data.qpos[places], data.qvel[dofs], data.qacc[dofs] = one
        mujoco.mj_inverse(model, data)
        found.append(data.qfrc_inverse[dofs].copy())
    return np.array(found)
