# Copyright 2026 plc_inspect contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Disjoint sets: each item leads to another of its set, one of them to itself."""

from numba import njit


@njit(cache=True, nogil=True)
def find_root(parent, item):  # type: ignore[no-untyped-def]
    """Follow (N,) int leads from an item to the one that leads to itself, and shorten them."""
    while parent[item] != item:
        parent[item] = parent[parent[item]]
        item = parent[item]
    return item
