# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What one browser is sent."""

import contextlib
from types import SimpleNamespace

import numpy as np
from stream_pieces import make_rows, Source

from plc_inspect.monitor.picture.model import Monitor
from plc_inspect.monitor.web.panel import Panel

NUM_UPDATES = 20


class Handle:
    """An element of the page that keeps all it was sent."""

    def __init__(self, content=''):
        self.sent = [content]
        self.value, self.options = 'none', ('none',)

    @property
    def content(self):
        """What the element shows."""
        return self.sent[-1]

    @content.setter
    def content(self, text):
        self.sent.append(text)

    def on_update(self, function):
        """Never call back."""

    def add_tab(self, name):
        """Return something that can be entered."""
        return contextlib.nullcontext()


class Client:
    """A browser without a connection."""

    def __init__(self):
        self.texts = []
        self.camera = SimpleNamespace(image_height=600, image_width=800, position=np.zeros(3),
                                      look_at=np.zeros(3))
        self.gui = SimpleNamespace(
            add_html=self._add_html, add_checkbox=lambda *_: Handle(),
            add_dropdown=lambda *_: Handle(), add_tab_group=Handle,
        )

    def _add_html(self, content):
        self.texts.append(Handle(content))
        return self.texts[-1]

    def atomic(self):
        """Return something that can be entered."""
        return contextlib.nullcontext()


def test_a_browser_gets_the_style_sheet_once():
    client, monitor, source = Client(), Monitor(), Source()
    panel = Panel(client, lambda: np.zeros(3), lambda span: monitor.cloud.cut_out(
        np.array(span.start), np.array(span.end), 6.0))
    for number in range(NUM_UPDATES):
        monitor.take_summary(
            source.summary(number, keyframe=not number, tables=make_rows(6, 1 + number % 3)),
            100.0 + number,
        )
        panel.update(monitor.look(100.2 + number), not number)
    panel.choose_hazard(0)
    sent = [text for handle in client.texts for text in handle.sent]
    assert len(sent) > 2 * NUM_UPDATES
    assert sum('<style' in text for text in sent) == 1
    assert '<style' in client.texts[0].content  # before anything that it is for
