# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""How near the vehicle is to what is known, and that nothing unseen is called clear."""

from dataclasses import replace
import math
from types import SimpleNamespace

import numpy as np
import pytest
from spans import make_span

from plc_inspect.config import MapSettings
from plc_inspect.core.live.motion import Motion
from plc_inspect.core.live.proximity import HORIZON, Level, measure_proximity, Thing
from plc_inspect.core.live.surroundings import (
    find_sigma,
    MOST_EXTENSION,
    MOST_RISE,
    MOST_SIGMA,
    RANGE,
    SETTLED,
    SPACING,
    SurroundingsBook,
)
from plc_inspect.core.live.window import Window
from plc_inspect.core.voxel_buffer.voxel_map import VoxelMap
from plc_inspect.node_config import ProximitySettings
from plc_inspect.results import Decision

SETTINGS = ProximitySettings()
CELL = 8.0
STANDING = np.zeros(3)
GROUND = (0.0, 0.0, 0.0)
LOW, HIGH = (-60.0, -60.0, 10.0), (60.0, 60.0, 130.0)


def make_around(spans=(), points=(), decision=(), size=10, vehicle=None):
    """Return the surroundings after a tick that saw ``size`` cells each way about the origin."""
    points = np.array(points, dtype=np.float64).reshape(-1, 3)
    cells = np.stack(np.meshgrid(*2 * [np.arange(-size, size)], indexing='ij'), -1)
    book = SurroundingsBook()
    for _ in range(1 + SETTLED):
        update(book, spans, points, decision, cells.reshape(-1, 2), vehicle)
    return book.known


def update(book, spans, points, decision, cells, vehicle=None, *, ground=True):
    """Show a tick to the book; z of its points is above the ground, if any was seen."""
    decision = np.array(decision, dtype=np.uint8)
    height = points[:, 2] if ground else np.full(len(points), np.nan)
    window = Window(
        slots=np.arange(len(points)), points=points, fresh=cells, cell_size=CELL,
        spans=frozenset(), sequence=1,
    )
    result = SimpleNamespace(decision=decision, ground_height=height)
    book.update(spans, window, result, vehicle)


def look(around, position, velocity=STANDING, settings=SETTINGS, *, seen=True):
    found = measure_proximity(
        around, seen, np.array(position, dtype=np.float64), np.array(velocity, dtype=np.float64),
        settings,
    )
    assert [item.thing for item in found] == list(Thing)
    return found


def sample(span, low, high):
    x = np.linspace(low, high, 40_001)
    unit = (span.end - span.start)[:2] / span.length
    return np.column_stack([span.start[:2] + x[:, None] * unit, span.heights(x)])


@pytest.mark.parametrize('seed', range(6))
def test_the_nearest_place_of_conductors_is_that_of_dense_samples(seed):
    rng = np.random.default_rng(seed)
    spans = [
        make_span(rng.uniform(LOW, HIGH), rng.uniform(LOW, HIGH),
                  c=float(rng.uniform(80, 2000)))
        for _ in range(4)
    ]
    places = np.concatenate([sample(span, 0.0, span.length) for span in spans])
    around = make_around(spans)
    for _ in range(20):
        position, velocity = rng.uniform(LOW, HIGH), rng.normal(0.0, 5.0, 3)
        found = look(around, position, velocity)[0]
        distance = np.linalg.norm(places - position, axis=1)
        assert found.distance == pytest.approx(distance.min(), abs=0.01)
        assert np.linalg.norm(found.position - position) == pytest.approx(found.distance, abs=1e-6)
        way = [
            np.linalg.norm(places[::20] - position - time * velocity, axis=1).min()
            for time in np.arange(0.0, HORIZON, 0.25)
        ]
        assert found.closest == pytest.approx(min(way), abs=0.7)
        assert found.closest <= found.distance
        at = position + found.closest_in * velocity
        assert np.linalg.norm(places - at, axis=1).min() == pytest.approx(found.closest, abs=0.01)


@pytest.mark.parametrize(('away', 'level'), [
    (7.9, Level.CRITICAL), (8.1, Level.WARNING), (14.9, Level.WARNING), (15.1, Level.CLEAR),
])
def test_levels_by_distance(away, level):
    around = make_around([make_span((-40.0, 0.0, 20.0), (40.0, 0.0, 20.0), c=1e6)])
    conductor, support, obstacle = look(around, (0.0, away, 20.0))
    assert conductor.level == level
    assert conductor.distance == pytest.approx(away, abs=0.01)
    assert (conductor.line_id, conductor.span_id) == (0, 0)
    assert not conductor.extended
    for other in (support, obstacle):
        assert other.level == Level.CLEAR
        assert math.isnan(other.distance)


def test_what_was_not_seen_is_never_clear():
    span = make_span((-40.0, 0.0, 20.0), (40.0, 0.0, 20.0))
    for around in (SurroundingsBook().known, make_around([span])):
        found = look(around, (0.0, 20.0, 20.0), seen=False)
        assert {item.level for item in found} == {Level.UNKNOWN}
    # but what is known to be near is told all the same
    assert look(make_around([span]), (0.0, 5.0, 20.0), seen=False)[0].level == Level.CRITICAL


def test_seen_is_what_the_map_holds_all_about_and_ticks_have_looked_at():
    voxels = VoxelMap(MapSettings(max_voxels=100_000))
    ground = np.mgrid[-40.0:40.0:0.5, -40.0:40.0:0.5].reshape(2, -1).T
    voxels.insert(np.column_stack((ground, np.zeros(len(ground)))))
    cells, beta = voxels.cells, 2.0
    assert not SurroundingsBook().known.is_seen(cells, np.array([0.0, 0.0, 20.0]), 15.0, beta)
    nothing = make_around([], [GROUND], [Decision.GROUND], size=0)
    assert nothing.is_seen(cells, np.array([0.0, 0.0, 20.0]), 15.0, beta)  # an open field
    assert nothing.is_seen(cells, np.array([24.0, 0.0, 20.0]), 15.0, beta)
    assert not nothing.is_seen(cells, np.array([26.0, 0.0, 20.0]), 15.0, beta)
    assert not nothing.is_seen(cells, np.array([np.nan, 0.0, 20.0]), 15.0, beta)
    assert not nothing.is_seen(cells, np.array([1e300, 0.0, 20.0]), 15.0, beta)
    voxels.insert(np.array([[3.0, 3.0, 9.0]]))  # something stands there
    assert not nothing.is_seen(cells, np.array([0.0, 0.0, 20.0]), 15.0, beta)
    book, place = SurroundingsBook(), cells.locate(np.array([[3.0, 3.0]]))
    for number in range(1 + SETTLED):
        assert not book.known.is_seen(cells, np.array([0.0, 0.0, 20.0]), 15.0, beta), number
        update(book, [], np.array([GROUND]), [Decision.GROUND], place)
    assert book.known.is_seen(cells, np.array([0.0, 0.0, 20.0]), 15.0, beta)


def test_where_no_ground_was_seen_everything_is_in_the_air():
    wire, moving = (0.0, 5.0, 12.0), np.array([5.0, 0.0, 0.0])
    book, field = SurroundingsBook(), np.array([[0, 0], [0, -1], [-1, 0], [-1, -1]])
    assert book.known.may_hold_ground(STANDING)
    assert book.known.may_hold_ground(np.full(3, np.nan))
    assert not book.known.may_hold_ground(moving)
    at = np.zeros(3)
    update(book, [], np.array([wire]), [Decision.NO_CATENARY], field, at, ground=False)
    assert len(book.known.obstacles) == 1
    assert not book.known.may_hold_ground(STANDING)
    update(book, [], np.array([GROUND]), [Decision.GROUND], field, at)
    assert len(book.known.obstacles) == 0
    assert book.known.may_hold_ground(moving)
    beside = at + 0.9 * RANGE
    update(book, [], np.array([wire]), [Decision.NO_CATENARY], field, beside, ground=False)
    assert book.known.may_hold_ground(moving)  # that of a moment ago is near
    far = np.array([3.0 * RANGE, 0.0, 0.0])
    update(book, [], np.empty((0, 3)), [], field, far)
    assert book.known.may_hold_ground(moving)  # nothing is near: nobody knows better
    update(book, [], np.array([wire]) + far, [Decision.NO_CATENARY], field, far, ground=False)
    assert not book.known.may_hold_ground(moving)


def test_a_conductor_goes_on_beyond_an_open_end_only():
    ends = (-40.0, 0.0, 20.0), (40.0, 0.0, 20.0)
    hung, free = make_span(*ends, c=800.0), make_span(*ends, c=800.0, is_open=(False, True))
    position = (65.0, 5.0, 21.0)
    assert look(make_around([hung]), position)[0].distance == pytest.approx(25.5, abs=0.1)
    found = look(make_around([free]), position)[0]
    assert found.extended
    assert found.distance == pytest.approx(5.0, abs=0.3)
    assert found.sigma > find_sigma(free, 0.0)
    far = look(make_around([free]), (200.0, 0.0, 20.0))[0]
    beyond = far.position[0] - 40.0
    assert far.position[2] == pytest.approx(20.0 + MOST_RISE)
    assert beyond < MOST_EXTENSION
    assert find_sigma(free, beyond) < MOST_SIGMA
    flat = make_span(*ends, c=1e5, is_open=(True, True))
    for side in (-1.0, 1.0):
        far = look(make_around([flat]), (200.0 * side, 0.0, 20.0))[0]
        beyond = abs(far.position[0]) - 40.0
        assert beyond == pytest.approx(MOST_EXTENSION) or (
            find_sigma(flat, beyond) == pytest.approx(MOST_SIGMA, rel=0.05)
        )


@pytest.mark.parametrize('side', [-1.0, 1.0])
def test_a_bundle_is_as_near_as_its_nearest_conductor(side):
    strands = np.array([[-0.2, -0.1], [0.2, -0.1], [0.0, 0.25]])
    span = replace(make_span((0.0, 0.0, 20.0), (80.0, 0.0, 20.0)), strands=strands)
    x = np.linspace(0.0, 80.0, 80_001)
    places = [
        np.column_stack([x, np.full(len(x), left), span.heights(x) + above])
        for left, above in strands
    ]
    vehicle = np.array([33.0, side * 6.0, 17.0])
    found = look(make_around([span]), vehicle)[Thing.CONDUCTOR]
    apart = [np.linalg.norm(own - vehicle, axis=1).min() for own in places]
    assert found.distance == pytest.approx(min(apart), abs=1e-3)
    nearest = places[int(np.argmin(apart))]
    assert np.linalg.norm(nearest - found.position, axis=1).min() < 1e-3
    assert (found.line_id, found.span_id) == (span.line_id, span.span_id)


def test_the_way_to_a_pole_and_a_tree():
    points = [(30.0, 2.0, 10.0), (0.0, 40.0, 6.0)]
    around = make_around([], points, [Decision.SUPPORT, Decision.NOT_LINEAR])
    _, pole, tree = look(around, (0.0, 0.0, 10.0), (5.0, 0.0, 0.0))
    assert pole.distance == pytest.approx(math.hypot(30.0, 2.0))
    assert (pole.closest, pole.closest_in) == (pytest.approx(2.0), pytest.approx(6.0))
    assert tree.distance == pytest.approx(math.hypot(40.0, 4.0))
    assert tree.closest_in == pytest.approx(0.0)
    np.testing.assert_array_equal(tree.position, points[1])
    assert tree.sigma >= SPACING / 2
    _, pole, _ = look(around, (0.0, 0.0, 10.0), (np.nan,) * 3)
    assert math.isnan(pole.closest)
    assert math.isnan(pole.closest_in)


def test_fresh_returns_are_obstacles_where_they_are_of_no_known_thing():
    span, pole = make_span((0.0, 0.0, 10.0), (100.0, 0.0, 10.0)), (52.0, 4.0, 10.0)
    around = make_around(
        [make_span((0.0, 300.0, 10.0), (100.0, 300.0, 10.0), 1), span], [pole], [Decision.SUPPORT]
    )
    on = span.positions(np.linspace(45.0, 55.0, 50))
    position, aside = np.array([50.0, 3.0, 10.0]), np.array([0.0, 1.0, 1.0])
    fresh = [on + 0.3 * aside, np.array([pole]) + 0.4]

    def look_at(points):
        found = measure_proximity(around, True, position, STANDING, SETTINGS, points)
        return found[Thing.OBSTACLE]

    assert look_at(np.concatenate(fresh)).level == Level.CLEAR
    other = on - [[0.0, 2.0, 0.0]]
    found = look_at(np.concatenate((*fresh, other)))
    assert found.level == Level.CRITICAL
    assert found.distance == pytest.approx(np.linalg.norm(other - position, axis=1).min())


def test_ticks_replace_what_they_saw_whole():
    book = SurroundingsBook()
    cells = np.array([[0, 0], [1, 0]])
    points = np.array([
        [1.0, 1.0, 5.0], [1.01, 1.0, 5.0], [9.0, 1.0, 5.0], [2.0, 2.0, 0.2], [3.0, 3.0, 9.0],
        [30.0, 1.0, 5.0],
    ])
    decision = [Decision.NOT_LINEAR] * 3 + [Decision.GROUND, Decision.WIRE, Decision.NOT_LINEAR]
    update(book, [], points, decision, cells)
    # thinned, off the ground, no wire, in cells that are whole
    np.testing.assert_array_equal(book.known.obstacles, points[[0, 2]])
    assert not len(book.known.supports)
    update(book, [], points[:0], [], cells[:1])
    np.testing.assert_array_equal(book.known.obstacles, points[[2]])
    assert not book.known.settled  # not yet: a conductor may not be found at once
    for _ in range(SETTLED):
        update(book, [], points[:0], [], cells[:0])
    assert book.known.settled == {(0, 0), (1, 0)}
    update(book, [], points[:0], [], cells[:0], np.array([9.0 + RANGE + 1.0, 1.0]))
    assert not len(book.known.obstacles)
    assert len(book.known.settled) == 2
    update(book, [], points[:0], [], cells[:0], np.array([500.0, 1.0]))
    assert not book.known.settled


def test_velocity_from_poses():
    motion = Motion()
    assert np.isnan(motion.velocity).all()
    for number in range(20):
        time = 0.05 * number
        motion.add(int(time * 1e9), np.array([3.0 * time, -time, 20.0]))
    np.testing.assert_allclose(motion.velocity, [3.0, -1.0, 0.0], atol=1e-9)
    motion.add(int(3.0e9), np.zeros(3))
    assert np.isnan(motion.velocity).all()
    motion.add(int(2.9e9), np.zeros(3))
    assert np.isnan(motion.velocity).all()
