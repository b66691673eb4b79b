# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""What all tests start from."""

import signal

# In the background of a shell interrupts are ignored, and programs that tests start would
# inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)
