"""The Linux counter's driver on a tree of files like sysfs'."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from arm_io import DeviceFault, InputError
from drivers import RigContext
from drivers import linux_counter as driver
from drivers.blocks import join
from drivers.counting import extend
from drivers.protocols import CounterMode, EdgeSource, Plan, Quality
from sim_backend.protocol import linux_counter as simulator
from tests.drivers.swing import counts, swing_wires

POLL = Plan(EdgeSource.POLL, 100.0, None)


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[tuple[driver.LinuxCounter, simulator.SimulatedCounter]]:
    where = driver.Config(sysfs=str(tmp_path), counts=(0, 2), patience=2.0)
    box = simulator.make("counter", where, swing_wires())
    box.open()
    device = driver.make("counter", where, RigContext())
    yield device, box
    device.close()
    box.close()


def test_counts_and_the_skew_that_it_states(rig) -> None:
    device, _ = rig
    identity = device.open()
    assert identity.model == "104-quad-8" and identity.bits == 24
    assert 0 < identity.channel_skew < 1e-3 and identity.max_rate > 100
    assert device.check() == []
    device.preset(0, 1 << 23)
    time.sleep(0.02)
    device.arm(POLL)
    start = device.poll()
    blocks = []
    for _ in range(30):
        blocks.append(device.poll())
        time.sleep(0.005)
    block = join([start, *blocks], 2)
    turned = extend(block.counts[:, 0], 24, int(start.counts[0, 0]))
    truth = counts(0, block.host)
    assert abs(int(start.counts[0, 0]) - (1 << 23)) < 2000
    assert np.abs((turned - turned[0]) - (truth - truth[0])).max() < 600
    assert not block.quality.any()


def test_modes(rig) -> None:
    device, box = rig
    device.open()
    device.configure(1, CounterMode.X1)
    assert (box._folder / "count2" / "function").read_text() == "quadrature x1 a\n"
    assert device.check() == []


def test_a_module_unloaded_and_loaded_again(rig) -> None:
    device, box = rig
    device.open()
    device.arm(POLL)
    assert not device.poll().quality.any()
    box.unload()
    assert (device.poll().quality == Quality.MISSING).all()
    assert "kernel module" in device.check()[0]
    box.load()
    end = time.monotonic() + 2
    while (quality := device.poll().quality)[0, 0] & Quality.MISSING and time.monotonic() < end:
        time.sleep(0.02)
    assert (quality == Quality.DEVICE_RESET).all()


def test_no_counter_at_all(tmp_path: Path) -> None:
    with pytest.raises(DeviceFault, match="kernel module"):
        driver.make("counter", driver.Config(sysfs=str(tmp_path)), RigContext()).open()
    with pytest.raises(InputError, match="a simulated counter cannot be in"):
        simulator.make("counter", driver.Config(), swing_wires())
