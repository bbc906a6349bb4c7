"""Analysis of many arms and nights on many machines: one task per arm and night on Dask, results stored by content.

Dask schedules, retries and moves data. This package defines the tasks, limits them, stores each result once, and judges
the results of all arms together.
"""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from arm_fleet.fetching import fetched
    from arm_fleet.fleet import Fleet, fleet_of
    from arm_fleet.parts import ArmTasks
    from arm_fleet.plan import Plan, read_plan
    from arm_fleet.recordings import ArmNight, arm_nights
    from arm_fleet.simulation.recordings import Scene, write_fleet
    from arm_fleet.simulation.wear import lives
    from arm_fleet.tasks.cluster import Cluster
    from arm_fleet.tasks.engine import Engine
    from arm_fleet.tasks.store import Store
    from arm_fleet.tasks.task import Task
    from arm_fleet.tasks.version import code_version
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "ArmNight",
    "ArmTasks",
    "Cluster",
    "Engine",
    "Fleet",
    "Plan",
    "Scene",
    "Store",
    "Task",
    "arm_nights",
    "code_version",
    "fetched",
    "fleet_of",
    "lives",
    "read_plan",
    "write_fleet",
]
