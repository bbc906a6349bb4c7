"""Distances against an independent oracle, MuJoCo's, and motions against a look at every instant."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arm_clearance.approach import EXACT, nearest
from arm_clearance.distances import segment_to_box, segment_to_segment
from arm_clearance.pairs import pairs_of
from arm_clearance.space import Box, Space
from arm_model import Arm, Joint
from arm_model.collision import chain_of
from arm_model.description import Coupling
from experiment import STEP, Experiment, demand_of

FAR = 100.0
place = st.floats(-2.0, 2.0).map(lambda x: round(x, 3))
point = st.tuples(place, place, place)
radius = st.floats(0.01, 0.3).map(lambda x: round(x, 3))
SCENE = """<mujoco><worldbody>
<geom name="a" type="capsule" fromto="{a}" size="{r}"/>
<geom name="b" type="{kind}" {b} />
</worldbody></mujoco>"""


def _mujoco(a: np.ndarray, r: float, kind: str, b: str) -> float:
    model = mujoco.MjModel.from_xml_string(SCENE.format(a=" ".join(map(str, a.ravel())), r=r, kind=kind, b=b))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return float(mujoco.mj_geomDistance(model, data, 0, 1, FAR, None))


@settings(max_examples=60)
@given(a=st.tuples(point, point), b=st.tuples(point, point), r=st.tuples(radius, radius))
def test_capsules_are_as_far_apart_as_mujoco_says(a: tuple, b: tuple, r: tuple) -> None:
    one, other = np.array(a), np.array(b)
    if min(np.linalg.norm(one[1] - one[0]), np.linalg.norm(other[1] - other[0])) < 0.01:
        one[1, 0] += 3.0  # MuJoCo takes no capsule without a length
        other[1, 0] += 3.0
    found = segment_to_segment(one[0], one[1], other[0], other[1]) - sum(r)
    expected = _mujoco(one, r[0], "capsule", f'fromto="{" ".join(map(str, other.ravel()))}" size="{r[1]}"')
    assert found == pytest.approx(expected, abs=1e-6) or (found < 0.0 and expected < 0.0)


@settings(max_examples=60)
@given(a=st.tuples(point, point), middle=point, half=st.tuples(radius, radius, radius), r=radius)
def test_capsule_and_box_are_as_far_apart_as_mujoco_says(a: tuple, middle: tuple, half: tuple, r: float) -> None:
    one, centre, size = np.array(a), np.array(middle), np.array(half)
    if np.linalg.norm(one[1] - one[0]) < 0.01:
        one[1, 0] += 3.0
    found = segment_to_box(one[0], one[1], centre - size, centre + size) - r
    numbers = f'pos="{" ".join(map(str, centre))}" size="{" ".join(map(str, size))}"'
    expected = _mujoco(one, r, "box", numbers)
    assert found == pytest.approx(expected, abs=2e-5) or (found < 0.0 and expected < 0.0)


def _arm(random: np.random.Generator) -> Arm:
    """1 to 6 joints anywhere, revolute and prismatic."""
    joints = tuple(
        Joint(
            type="revolute" if random.random() < 0.75 else "prismatic",
            convention="placed",
            xyz=tuple(random.uniform(-0.5, 0.5, 3).tolist()),
            rpy=tuple(random.uniform(-3.0, 3.0, 3).tolist()),
            axis=tuple(random.uniform(0.1, 1.0, 3).tolist()),
        )
        for _ in range(random.integers(1, 7))
    )
    n = len(joints)
    coupled = (Coupling(n, n - 1, 0.7),) if n > 1 and joints[-1].type == joints[-2].type else ()
    return Arm(name="any", joints=joints, coupling=coupled)


def _motion(n: int, random: np.random.Generator, times: int = 1) -> Experiment:
    segments = [
        {"type": "move", "to": random.uniform(-2.0, 2.0, n).tolist()},
        {"type": "hold", "duration": 0.3},
        {"type": "chirp", "joint": int(random.integers(1, n + 1)), "amplitude": 0.4, "frequency": 0.5}
        | {"to_frequency": 1.5, "duration": 2.0},
        {"type": "fourier", "duration": 6.0, "fundamental": 1.0, "fade": 0.5}
        | {"sine": random.uniform(-0.3, 0.3, (n, 2)).tolist(), "cosine": random.uniform(-0.3, 0.3, (n, 2)).tolist()},
    ]
    table = {"name": "any", "start": [0.0] * n, "full_speed": [1.5] * n, "full_acceleration": [5.0] * n}
    return Experiment.model_validate(table | {"segment": [{"type": "repeat", "times": times, "segment": segments}]})


SPACE = Space(floor=-0.6, box=[Box(name="crate", low=(0.3, -0.2, -0.1), high=(0.6, 0.4, 0.3))], low=(-3, -3, -3))


@pytest.mark.parametrize("seed", range(8))
def test_the_nearest_is_that_of_a_look_at_every_instant(seed: int) -> None:
    random = np.random.default_rng(seed)
    arm = _arm(random)
    pairs = pairs_of(chain_of(arm), SPACE)
    demand = demand_of(_motion(len(arm), random))
    found = nearest(demand, pairs)
    t = np.arange(0.0, demand.duration + STEP, STEP)
    room = pairs.clearance(demand(t)) - pairs.required()
    assert found is not None
    assert abs(found.room - room.min()) < 2 * EXACT
    there = pairs.clearance(demand(np.array([found.time])))[0]
    assert found.clearance in there.tolist() or np.abs(there - found.clearance).min() < 1e-9


@pytest.mark.parametrize("seed", range(4))
def test_points_move_no_faster_than_their_reach(seed: int) -> None:
    random = np.random.default_rng(seed)
    arm = replace(_arm(random), coupling=())
    chain = chain_of(arm)
    q = random.uniform(-1.5, 1.5, (200, len(arm)))
    reach = chain.reach(np.full(len(arm), 1.5))
    for j in range(len(arm)):
        step = np.zeros(len(arm))
        step[j] = 1e-6
        way = np.linalg.norm(chain.points(q + step) - chain.points(q - step), axis=-1) / 2e-6
        assert (way <= reach[j] + 1e-6).all()


@pytest.mark.parametrize("seed", range(3))
def test_a_day_is_looked_at_like_a_minute(seed: int) -> None:
    """By the number of poses that are computed, and to the same distance."""
    random = np.random.default_rng(seed)
    arm = _arm(random)
    pairs = pairs_of(chain_of(arm), SPACE)
    n, state, looked = len(arm), random.bit_generator.state, []

    class Counting(type(pairs)):  # type: ignore[misc]
        def clearance(self, q: np.ndarray) -> np.ndarray:
            looked[-1] += len(q)
            return super().clearance(q)

    counting = Counting(**{name: getattr(pairs, name) for name in pairs.__dataclass_fields__})
    least = []
    for times in (4, 8000):
        random.bit_generator.state = state
        # a repeat that returns to where it began: the same poses every time
        demand = demand_of(_motion(n, random, times))
        looked.append(0)
        found = nearest(demand, counting)
        assert found is not None
        least.append(found.room)
    assert demand.duration > 0.7 * 86400
    assert looked[1] < 2 * looked[0] + 1000
    assert least[1] == pytest.approx(least[0], abs=EXACT)
