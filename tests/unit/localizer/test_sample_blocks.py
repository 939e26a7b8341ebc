"""Samples brought together: by time, by hold, by direction; never more blocks than can be solved at once."""

import math

import numpy as np
import pytest

from pointit.services.localizer.estimation.sample_blocks import BLOCK_S, MAX_BLOCKS, Pointings, blocks


def gathered(stamps_s: list[float], azimuths_rad: list[float], targets_x: list[float]) -> Pointings:
    azimuths = np.array(azimuths_rad)
    count = len(azimuths)
    return Pointings(
        np.array(stamps_s),
        np.tile([0.0, 0.0, 1.6], (count, 1)),
        np.column_stack([np.cos(azimuths), np.sin(azimuths), np.zeros(count)]),
        np.column_stack([targets_x, np.zeros(count), np.zeros(count)]),
    )


def test_a_block_is_the_mean_of_what_was_measured_within_its_time() -> None:
    stamps = [0.0, 0.05, 0.10, BLOCK_S + 0.01]
    summary = blocks(gathered(stamps, [0.1, 0.2, 0.3, 0.5], [2.0] * 4))
    assert summary.samples.tolist() == [3.0, 1.0]
    means = summary.pointings.directions
    assert np.arctan2(means[:, 1], means[:, 0]) == pytest.approx([0.2, 0.5], abs=1e-3)
    assert np.linalg.norm(means, axis=1) == pytest.approx([1.0, 1.0])


def test_a_ray_that_leaps_belongs_to_another_block() -> None:
    summary = blocks(gathered([0.0, 0.02, 0.04, 0.06], [0.0, 0.0, 1.5, 1.5], [2.0] * 4))
    assert summary.samples.tolist() == [2.0, 2.0]
    assert summary.hold.tolist() == [0.0, 0.0]
    opposite = blocks(gathered([0.0, 0.02], [0.0, math.pi], [2.0] * 2))  # their mean would be no direction
    assert np.all(np.isfinite(opposite.pointings.directions))


def test_a_hold_ends_with_a_pause_or_another_target() -> None:
    summary = blocks(gathered([0.0, 0.1, 2.0, 2.1, 2.2, 2.3], [0.0] * 6, [2.0, 2.0, 2.0, 2.0, 3.0, 3.0]))
    assert sorted(set(summary.hold.tolist())) == [0.0, 1.0, 2.0]
    assert summary.held_s == pytest.approx([0.1, 0.1, 0.1])
    assert summary.is_still


def test_a_target_that_creeps_moves_and_one_that_trembles_does_not() -> None:
    stamps = [0.1 * i for i in range(20)]
    assert not blocks(gathered(stamps, [0.0] * 20, [2.0 + 0.02 * i for i in range(20)])).is_still
    assert blocks(gathered(stamps, [0.0] * 20, [2.0 + 0.01 * (i % 2) for i in range(20)])).is_still


def test_however_long_it_lasts_the_blocks_are_few() -> None:
    count = 8192
    summary = blocks(gathered([i / 20.0 for i in range(count)], [0.0] * count, [2.0] * count))
    assert MAX_BLOCKS <= len(summary.samples) <= MAX_BLOCKS + 1
    assert summary.samples.sum() == count
