# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What the log says of hazards."""

from spans import make_hazard

from plc_inspect.core.tracking.hazard_tracking import HazardNews
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
