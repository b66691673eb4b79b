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

from plc_inspect.core.alignment import AlignmentResult
from plc_inspect.core.clustering import ClusteringResult
from plc_inspect.core.conductors import ConductorResult
from plc_inspect.core.corridor import CorridorResult
from plc_inspect.core.height import HeightResult
from plc_inspect.core.linearity import LinearityResult
from plc_inspect.core.off_ground import OffGround
from plc_inspect.core.outliers import OutlierResult
from plc_inspect.core.span_model import SpanModel
from plc_inspect.results import InspectionResult


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trace:
    """The result of one run, and what the stages gave each other on the way."""

    result: InspectionResult
    height: HeightResult
    """Of the ground that was believed in the end."""
    cloud: OffGround
    """Points off the ground as the stages from linearity to catenary saw them."""
    candidates: LinearityResult
    outliers: OutlierResult
    """Of the candidates."""
    inliers: LinearityResult
    """Candidates that are no outliers."""
    alignment: AlignmentResult
    """Of the inliers."""
    clustering: ClusteringResult
    conductors: ConductorResult
    models: tuple[SpanModel, ...]
    """Spans with their curves, in the order of those of the result."""
    corridor: CorridorResult
