# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What the log says of hazards."""

from rclpy.logging import get_logger
from spans import make_hazard

from plc_inspect.core.tracking.hazard_tracking import HazardNews
from plc_inspect.ros.graph.voices import Voices
from plc_inspect.ros.results.teller import tell_hazards


def test_a_hazard_that_is_taken_back_is_warned_of_with_the_reason():
    one, other = (make_hazard((1.0, 2.0, 3.0), hazard_id=number) for number in (4, 7))
    said, warned = [], []
    news = HazardNews(raised=(one,), updated=(other,)).clear([other], 'the wind')
    tell_hazards(news, said.append, warned.append)
    assert [text[:16] for text in said] == ['hazard 4 raised:', 'hazard 7 updated']
    (text,) = warned
    assert text.startswith('hazard 7 cleared: warning, vegetation 3.00 m')
    assert text.endswith('; the wind')


def test_a_real_log_takes_what_is_raised_and_what_is_taken_back(capfd):
    """A line of code that logs with two severities is a ValueError of rclpy."""
    one, other = (make_hazard((1.0, 2.0, 3.0), hazard_id=number) for number in (4, 7))
    log = Voices(get_logger('test_teller'))
    for _ in range(2):
        tell_hazards(HazardNews(raised=(one,)).clear([other], 'the wind'), log.info, log.warning)
        tell_hazards(HazardNews(raised=(one,)).clear([other], 'the wind'), log.info, log.error)
    lines = capfd.readouterr().err.splitlines()
    assert [line.partition('INFO')[1] for line in lines] == ['INFO', ''] * 4
