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

"""What every stage found in one run of the pipeline."""

from dataclasses import dataclass

from plc_inspect.core.corridor import CorridorResult
from plc_inspect.core.span_model import SpanModel
from plc_inspect.core.tracing import FoundLines
from plc_inspect.results import InspectionResult


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trace(FoundLines):
    """The result of one run, and what the stages gave each other on the way."""

    result: InspectionResult
    corridor: CorridorResult

    @property
    def models(self) -> tuple[SpanModel, ...]:
        """Spans with their curves, in the order of those of the result."""
        return self.spans.models
