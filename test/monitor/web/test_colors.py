# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The table of severities, seen with eyes that miss one kind of cone."""

from itertools import combinations

from monitor.web.chrome import EYES, LEAST_DISTANCE, see
import numpy as np
import pytest

from plc_inspect.colors import LOOKS, parse_color
from plc_inspect.results import Severity


def contrast(first, second):
    """Return the contrast of two colours as WCAG 2 has it, 1 to 21."""
    light = []
    for color in (first, second):
        rgb = np.array(parse_color(color)) / 255.0
        linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
        light.append(linear @ np.array([0.2126, 0.7152, 0.0722]) + 0.05)
    return max(light) / min(light)


@pytest.mark.parametrize('eye', EYES)
def test_no_two_severities_look_alike(eye):
    for one, other in combinations(LOOKS.values(), 2):
        distance = np.linalg.norm(see(one.color, eye) - see(other.color, eye))
        assert distance >= LEAST_DISTANCE, (one.name, other.name)


def test_the_test_finds_red_and_green():
    assert np.linalg.norm(see('#c62828', 'deuteranomaly') - see('#2e9e4f', 'deuteranomaly')) < 15


def test_no_severity_is_told_by_its_colour_alone():
    assert len({look.shape for look in LOOKS.values()}) == len(LOOKS)
    assert len({look.word.lower() for look in LOOKS.values()}) == len(LOOKS)
    assert set(LOOKS) == {item.name.lower() for item in Severity} | {'ok'}


@pytest.mark.parametrize('look', LOOKS.values(), ids=LOOKS)
def test_text_upon_a_severity_can_be_read(look):
    assert contrast(look.color, look.ink) >= 4.5  # WCAG 2.2 AA, text
