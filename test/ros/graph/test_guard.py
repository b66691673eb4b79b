# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The node says for how long its certificates hold, whatever happens to them in flight."""

from diagnostic_msgs.msg import DiagnosticStatus
import pytest

from plc_inspect.node_config import SecuritySettings
from plc_inspect.ros.graph.guard import Guard
from plc_inspect.security.authority import issue, make_authority


@pytest.mark.parametrize(('change', 'told'), [
    (lambda path: path.write_bytes(path.read_bytes()[:100]), 'certificate cannot be read: '),
    (lambda path: path.unlink(), 'member.crt cannot be read: No such file or directory'),
])
def test_a_certificate_that_cannot_be_read_is_told(tmp_path, monkeypatch, change, told):
    path = tmp_path / 'member.crt'
    good = issue(make_authority('a', 100), 'b', 50).pem
    path.write_bytes(good)
    monkeypatch.setenv('PLC_KEYS', str(tmp_path))
    guard = Guard(SecuritySettings())
    values = {item.key: item.value for item in guard.describe().values}
    assert values['certificates end in [d]'] == '49'
    change(path)
    status = guard.describe()
    assert status.level == DiagnosticStatus.WARN
    assert told in status.message
    path.write_bytes(good)
    assert told not in guard.describe().message
