"""A rig of simulated devices on the follower plant, and a reader that runs it as a sampler would."""

from __future__ import annotations

from dataclasses import dataclass

from drivers import RigContext
from drivers.protocols import Block, EdgeSource, Plan
from experiment import Experiment
from sim_backend import lab_pc, mit_c12, optotrak, unimation
from sim_backend.rig.clock import FastClock
from sim_backend.rig.faults import Fault
from sim_backend.rig.latch import joined
from sim_backend.rig.settings import Simulation
from sim_backend.rig.world import World
from tests.sim_backend.plants import FollowerPlant, chirps


@dataclass
class Rig:
    """One of each device, open."""

    world: World
    counter: mit_c12.Card
    analog: lab_pc.Card
    tracker: optotrak.Tracker
    arm: unimation.Controller

    @property
    def acquiring(self) -> tuple[mit_c12.Card, lab_pc.Card, optotrak.Tracker]:
        """All but the arm."""
        return self.counter, self.analog, self.tracker


def make_rig(
    *,
    faults: tuple[Fault, ...] = (),
    seed: int = 1,
    simulation: dict | None = None,
    counter: dict | None = None,
    analog: dict | None = None,
    tracker: dict | None = None,
) -> Rig:
    """Six joints on one counter card, eight inputs, a tracker that streams all its points; a table of options each."""
    world = World(Simulation(seed=seed, fault=list(faults), **(simulation or {})), FollowerPlant(), FastClock())
    context = RigContext()
    context.shared("sim_backend", lambda: world)
    rig = Rig(
        world,
        mit_c12.Card("counter", mit_c12.Config(joints=[1, 2, 3, 4, 5, 6], bits=[24] * 6, **(counter or {})), world),
        lab_pc.Card("analog", lab_pc.Config(**({"conversion_rate": 250e3} | (analog or {}))), world),
        optotrak.make("tracker", optotrak.Config(**({"stream": 1000.0} | (tracker or {}))), context),
        unimation.Controller("arm", unimation.Config(), world),
    )
    for device in (*rig.acquiring, rig.arm):
        device.open()
    return rig


def begin(
    rig: Rig, rate: float = 1000.0, source: EdgeSource = EdgeSource.TRACKER, motion: Experiment | None = None
) -> None:
    """Loads, arms, starts."""
    rig.arm.load(motion or chirps())
    for device in (*rig.acquiring, rig.arm):
        device.arm(Plan(source, rate, None))
    rig.arm.start()
    rig.analog.write_line("start", True)


def read_for(rig: Rig, seconds: float, block: float = 0.01) -> dict[str, Block]:
    """All rows that the devices make meanwhile, by device, read every ``block`` s; edges under "edges"."""
    parts: dict[str, list[Block]] = {"counter": [], "analog": [], "tracker": [], "edges": []}
    for _ in range(round(seconds / block)):
        rig.world.clock.sleep(block)
        for device in rig.acquiring:
            if hasattr(device, "read"):
                parts[device.name].append(device.read())
        parts["edges"].append(rig.analog.read_edges())
    return {name: joined(blocks) for name, blocks in parts.items() if blocks}
