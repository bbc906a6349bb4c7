"""The sampler with the real drivers, on their protocols' simulators.

a T7 as the clock, a QSB that has to be asked beside it.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from daq.acquisition.acquisition import Acquisition
from daq.acquisition.states import End
from daq.rig.bench import Bench, open_bench
from daq.rig.rig_file import Rig
from drivers.labjack_t7 import device as labjack_t7
from drivers.protocols import Quality
from drivers.us_digital_qsb import device as us_digital_qsb
from sim_backend.protocol import labjack_t7 as simulated_t7
from sim_backend.protocol import us_digital_qsb as simulated_qsb
from tests.daq.benches import joined
from tests.drivers.swing import counts, swing_wires, volts
from tests.ports import free_port


@contextmanager
def on_the_bench(tmp_path: Path, rate: float = 500.0) -> Iterator[tuple[Bench, Any]]:
    """An open bench, and the simulated T7."""
    t7 = {"host": "127.0.0.1", "port": free_port(), "stream_port": free_port(), "timeout": 0.3, "patience": 3.0}
    qsb = {"port": str(tmp_path / "qsb"), "timeout": 0.2}
    sensor = {"device": "t7", "channel": 0, "rated_current": 200.0, "rated_voltage": 10.0}
    rig = Rig.model_validate(
        {
            "name": "on wires",
            "trigger": {"source": "timer", "device": "t7", "rate": rate},
            "device": [
                {"name": "qsb", "driver": "drivers.us_digital_qsb", **qsb},
                {"name": "t7", "driver": "drivers.labjack_t7", **t7},
            ],
            "joint": [
                {"encoder": {"device": "t7", "channel": 0, "counts_per_radian": 1e4}, "current": sensor},
                {"encoder": {"device": "qsb", "channel": 0, "counts_per_radian": 1e4, "preset": 0}},
            ],
        }
    )
    with ExitStack() as stack:
        box = simulated_t7.make("t7", labjack_t7.Config.model_validate(t7), swing_wires())
        other = simulated_qsb.make("qsb", us_digital_qsb.Config.model_validate(qsb), swing_wires())
        for simulator in (box, other):
            simulator.open()
            stack.callback(simulator.close)
        yield stack.enter_context(open_bench(rig)), box


def test_a_latched_and_an_asked_device_become_one_row(tmp_path: Path) -> None:
    with on_the_bench(tmp_path) as (bench, _):
        acquisition = Acquisition(bench, seconds=0.8)
        rows = joined(list(acquisition.rows()))
        assert acquisition.ending is not None and acquisition.ending.reason is End.ROWS_DONE
        assert np.array_equal(rows.number, np.arange(400))
        assert acquisition.ledger.summary().lost == 0
        names, _ = bench.columns.names()
        turned, asked = names.index("t7.0"), names.index("qsb.0")
        truth = counts(0, rows.host_ns)
        fresh = (rows.quality[:, asked] == Quality.GOOD) & (rows.number > 5)
        assert np.count_nonzero(fresh) > 50
        # counts; 31 a millisecond at most
        for column, slack, where in (
            (turned, 120, rows.number > 5),
            (asked, 300, fresh),
        ):
            measured = rows.counts[:, column] - rows.counts[0, column]
            error = np.abs(measured - (truth - truth[0]))[where]
            # Between the simulated QSB and the driver lie a thread of this process and one of the kernel (it moves what
            # a terminal
            # sent to its reader); on a busy machine both are late now and then, and no byte tells.
            assert (error.max() if column == turned else np.quantile(error, 0.9)) < slack
        assert np.abs(rows.volts[:, 0] - volts(0, rows.host_ns)).max() < 0.01
        quality = rows.quality[:, asked]
        assert not (quality & ~np.uint8(Quality.STALE | Quality.LATE | Quality.MISSING)).any()
        fits = {fit.device: fit for fit in acquisition.clocks()}
        assert abs(fits["t7"].tick_rate / 40e6 - 1) < 1e-3


def test_a_cable_pulled_and_plugged_in_again_costs_its_rows_and_no_more(tmp_path: Path) -> None:
    with on_the_bench(tmp_path) as (bench, box):
        acquisition = Acquisition(bench, seconds=1.5)
        blocks, plug = [], threading.Timer(0.15, box.plug_cable)
        for rows in acquisition.rows():
            blocks.append(rows)
            if acquisition.rows_made > 200 and not plug.is_alive() and not plug.finished.is_set():
                box.pull_cable()
                plug.start()
        account = acquisition.ledger.summary()
        assert acquisition.ending is not None and acquisition.ending.reason is End.ROWS_DONE, str(acquisition.ending)
        assert acquisition.ledger.imbalance() is None
        assert account.lost > 30 and all(loss.detail == "t7" for loss in account.losses)
        rows = joined(blocks)
        assert len(rows) + account.lost == 750
        # After the gap the rows are still those of their numbers, to the phase in which the T7's scan began again.
        on_grid = rows.host_ns[0] + (rows.number - rows.number[0]) * 2_000_000
        assert np.abs(rows.host_ns - on_grid).max() < 2_000_000
