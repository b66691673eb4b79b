# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What the page says: the numbers that were published, and nothing that could be code."""

import dataclasses
import re

from hypothesis import given, settings
from hypothesis.strategies import floats, integers, tuples
import numpy as np
from stream_pieces import make_rows, Source

from plc_inspect.monitor.picture.model import Monitor
from plc_inspect.monitor.terminal.text import print_once
from plc_inspect.monitor.web.markup import (
    draw_bar,
    draw_hazard,
    draw_hazards,
    draw_health,
    draw_profile,
    draw_spans,
)
from plc_inspect.monitor.web.scene_3d import color_cells
from plc_inspect.results import PointClass

NO_CELLS = (np.empty((0, 3), np.float32), np.empty(0, np.uint8), np.empty(0, np.float32),
            np.empty(0, np.float32))


def look(seconds=0.2):
    monitor, source = Monitor(), Source()
    monitor.take_summary(source.summary(5.0, keyframe=True), 100.0)
    return monitor.look(100.0 + seconds)


def cells(text):
    """Return the texts of all cells, row by row."""
    return [re.findall(r'<td>(?:<span[^>]*></span>)?(.*?)</td>', row)
            for row in re.findall(r'<tr.*?</tr>', text, re.DOTALL)]


def test_tables_hold_the_numbers():
    picture = look()
    assert cells(draw_hazards(picture))[1:] == [
        ['vegetation #0', '1.23', '2.00', '0/0'], ['vegetation #1', '2.23', '2.00', '1/0'],
        ['vegetation #2', '3.23', '2.00', '2/0'],
    ]
    spans = {row[0]: row[1:] for row in cells(draw_spans(picture))[1:]}
    assert set(spans) == {'0/0', '1/0', '2/0', '0/1 &hellip;', '1/1 &hellip;', '2/1 &hellip;'}
    row = make_rows().spans[0]
    assert spans['0/0'][1] == f'{int(row["sag"]) / 1000:.2f}'
    detail = dict(cells(draw_hazard(picture.hazards[0])))
    assert detail['clearance'].startswith('1.23')
    assert detail['line / span'] == '0 / 0'
    assert 'Choose a hazard' in draw_hazard(None)


def test_the_bar_says_how_old_everything_is():
    assert 'data-link="live"' in draw_bar(look())
    assert 'live &middot; data 0.2 s old' in draw_bar(look())
    assert 'late: nothing for 3.0 s' in draw_bar(look(3.0))
    assert 'LINK LOST for 45 s: all of this is old &middot; data 45 s old' in draw_bar(look(45.0))
    assert 'FROZEN' in draw_bar(look())
    assert 'waiting for the node' in draw_bar(Monitor().look(0.0))
    assert draw_bar(look()).count('class="alarm"') == 1
    old = dataclasses.replace(look(), ages=dataclasses.replace(look().ages, data=60.0))
    assert 'live, but nothing new' in draw_bar(old)


def test_lists_are_cut_to_what_one_reads():
    picture = look()
    (alarm,) = picture.alarms
    assert draw_bar(dataclasses.replace(picture, alarms=(alarm,) * 9)).count('ALARM') == 2
    events = tuple(dataclasses.replace(picture.events[0], text=f'event {k};') for k in range(50))
    text = draw_health(dataclasses.replace(picture, events=events))
    assert re.findall(r'event (\d+);', text) == [str(k) for k in range(49, 19, -1)]


def test_texts_of_the_node_are_not_code():
    picture = dataclasses.replace(look(), texts=('<script>x</script>', '', ''), levels=(1, 0, 0))
    assert '<script>' not in draw_health(picture)
    assert '&lt;script&gt;' in draw_health(picture)


def test_the_profile_shows_the_curve_and_what_is_below():
    picture = look()
    span = next(item for item in picture.spans if item.key == (0, 0))
    points = np.array([[30.0, -4.0, 8.0], [60.0, -4.0, 0.5]], np.float32)
    kinds = np.array([PointClass.VEGETATION, PointClass.GROUND], np.uint8)
    text = draw_profile(span, picture.hazards, (points, kinds, np.zeros(2, np.float32),
                                                np.full(2, 0.5, np.float32)))
    assert 'data-span="0/0"' in text
    assert f'length {span.length:.2f} m, sag {span.sag:.2f}' in text
    assert text.count('<circle') == 1
    assert '1.23 m' in text
    curve = re.search(r'points="([^"]*)"', text)[1].split()
    x, y = np.array([pair.split(',') for pair in curve], float).T
    assert (np.diff(x) > 0).all()
    assert y.argmax() not in (0, len(y) - 1)  # it hangs; y grows downwards
    assert re.search(r'M114 \d+h1', text)  # 30 m of 120 m, between 34 and 354
    assert 'Choose a span' in draw_profile(None, (), NO_CELLS)
    draw_profile(span, (), NO_CELLS)


def test_colors_tell_clearance():
    near, far, wire = color_cells(
        np.array([5, 5, PointClass.TOWER], np.uint8), np.array([1.0, np.nan, 0.0], np.float32)
    )
    assert near[0] > near[2] + 100
    assert far[2] > far[0]
    assert abs(int(wire[0]) - int(wire[2])) < 30
    assert color_cells(np.empty(0, np.uint8), np.empty(0, np.float32)).shape == (0, 3)


@given(
    a=floats(width=32), b=floats(width=32), c=floats(width=32),
    end=tuples(*[integers(-2**31, 2**31 - 1)] * 3),
)
@settings(max_examples=300, deadline=None)
def test_no_curve_of_the_stream_keeps_the_picture_from_being_drawn(a, b, c, end):
    source, monitor = Source(), Monitor()
    tables = make_rows(num_spans=2)
    row = tables.spans[0]
    row['a'], row['b'], row['c'] = a, b, c
    row['end_x'], row['end_y'], row['end_z'] = end
    taken = monitor.take_summary(source.summary(1.0, keyframe=True, tables=tables), 1.0)
    picture = monitor.look(1.0)
    assert taken == (picture.counts.malformed == 0) == (len(picture.spans) == 2)
    draw_spans(picture)
    print_once(picture, 'plc_inspect')
    for span in picture.spans:
        draw_profile(span, picture.hazards, NO_CELLS)
        assert np.isfinite(span.trace()).all()


def test_a_span_far_out_of_range_is_told_of():
    source, monitor = Source(), Monitor()
    tables = make_rows(num_spans=2)
    tables.spans[0]['c'] = 1e-3
    assert not monitor.take_summary(source.summary(1.0, keyframe=True, tables=tables), 1.0)
    assert 'has a curve that cannot be' in monitor.look(1.0).events[-1].text
