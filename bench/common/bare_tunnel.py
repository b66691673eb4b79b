# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The entrance of somebody without a certificate: ``bare_tunnel.py ADDRESS PORT OWN_PORT``."""

import asyncio
from pathlib import Path
import ssl
import sys

from plc_inspect.security.graph_profile import Place
from plc_inspect.security.tunnel import Tunnel


class BareTunnel(Tunnel):
    """Shows nothing and asks for nothing."""

    def _context(self, *, server: bool) -> ssl.SSLContext:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
        return context


if __name__ == '__main__':
    place = Place(sys.argv[1], int(sys.argv[2]))
    asyncio.run(BareTunnel(Path(), place, int(sys.argv[3])).connect())
