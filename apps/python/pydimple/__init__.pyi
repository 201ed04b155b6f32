# In a wheel, setup.py replaces `**options` by the keywords that the option table has for each function.
import dataclasses
import os
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

__version__: str
__all__: list[str]

_Path = str | os.PathLike[str]
_Image = _Path | npt.NDArray[Any]
_Tissue = Mapping[int | str, Mapping[str, float | str | Sequence[float]]]
_Named = Mapping[str, Mapping[str, float | str | Sequence[float]]]
_Floats = npt.NDArray[np.float64]

def build_model(
    image: _Image,
    *,
    affine: npt.ArrayLike | None = None,
    space: Literal["RAS", "LPS"] | None = None,
    config: _Path | None = None,
    tissue: _Tissue | None = None,
    supports: _Named | None = None,
    **options: Any,
) -> Model: ...
def usable_places(
    image: _Image,
    *,
    affine: npt.ArrayLike | None = None,
    space: Literal["RAS", "LPS"] | None = None,
    config: _Path | None = None,
    **options: Any,
) -> dict[str, Any]: ...
def solve(
    model: Model,
    *,
    config: _Path | None = None,
    tissue: _Tissue | None = None,
    pressures: _Named | None = None,
    supports: _Named | None = None,
    steps: _Named | None = None,
    membranes: _Named | None = None,
    walls: _Named | None = None,
    tools: _Named | None = None,
    **options: Any,
) -> Result: ...
def run(
    image: _Image,
    *,
    affine: npt.ArrayLike | None = None,
    space: Literal["RAS", "LPS"] | None = None,
    out: _Path | None = None,
    overwrite: bool = False,
    config: _Path | None = None,
    tissue: _Tissue | None = None,
    pressures: _Named | None = None,
    supports: _Named | None = None,
    steps: _Named | None = None,
    membranes: _Named | None = None,
    walls: _Named | None = None,
    tools: _Named | None = None,
    **options: Any,
) -> Result: ...
def limit_threads(count: int | None = None) -> None: ...

class Model:
    @property
    def positions_m(self) -> _Floats: ...
    @property
    def circle(self) -> npt.NDArray[np.int64]: ...
    @property
    def base(self) -> npt.NDArray[np.int64]: ...
    @property
    def points_m(self) -> _Floats: ...
    @property
    def volume_m3(self) -> _Floats: ...
    @property
    def label(self) -> npt.NDArray[np.int32]: ...
    @property
    def circle_centre_m(self) -> _Floats: ...
    @property
    def circle_radius_m(self) -> float: ...
    @property
    def push(self) -> _Floats: ...
    @property
    def surface_mm(self) -> _Floats: ...
    @property
    def triangles(self) -> npt.NDArray[np.int64]: ...
    def at_surface(self, nodal: npt.ArrayLike) -> _Floats: ...
    @property
    def report(self) -> dict[str, Any]: ...
    @property
    def warnings(self) -> list[str]: ...

class Result:
    @property
    def depth_m(self) -> _Floats: ...
    @property
    def force_N(self) -> _Floats: ...
    @property
    def base_force_N(self) -> _Floats: ...
    @property
    def time_s(self) -> _Floats: ...
    @property
    def force_on_tool_N(self) -> _Floats: ...
    @property
    def moment_on_tool_Nm(self) -> _Floats: ...
    @property
    def band(self) -> Band | None: ...
    @property
    def band_low_N(self) -> _Floats | None: ...
    @property
    def band_high_N(self) -> _Floats | None: ...
    @property
    def band_unknown(self) -> str: ...
    @property
    def displacement_m(self) -> _Floats: ...
    @property
    def nodal_parameter_m(self) -> _Floats: ...
    @property
    def frame_depth_m(self) -> _Floats: ...
    @property
    def frame_time_s(self) -> _Floats: ...
    @property
    def model(self) -> Model: ...
    @property
    def summary(self) -> dict[str, Any]: ...
    @property
    def warnings(self) -> list[str]: ...

@dataclasses.dataclass(frozen=True, eq=False)
class Band:
    low_N: _Floats
    high_N: _Floats

class Organ:
    def __init__(
        self,
        image: _Image,
        *,
        affine: npt.ArrayLike | None = None,
        space: Literal["RAS", "LPS"] | None = None,
        config: _Path | None = None,
        tissue: _Tissue | None = None,
        supports: _Named | None = None,
        **options: Any,
    ) -> None: ...
    def build_model(self, **options: Any) -> Model: ...
    def usable_places(self, **options: Any) -> dict[str, Any]: ...
    @property
    def warnings(self) -> list[str]: ...

_Three = tuple[float, float, float]

@dataclasses.dataclass(frozen=True)
class Frame:
    asked_mm: float
    depth_mm: float
    force_N: float
    error_N: float
    error_at_depth_N: float
    force_on_tool_N: _Three
    moment_on_tool_Nm: _Three
    force_direction: _Three
    moment_arm_m: _Three
    stiffness_N_per_m: float
    residual: float
    evaluations: int
    status: Literal["there", "lags", "stopped", "elsewhere", "beyond"]

class Session:
    def __init__(
        self,
        model: Model,
        *,
        config: _Path | None = None,
        tissue: _Tissue | None = None,
        pressures: _Named | None = None,
        supports: _Named | None = None,
        **options: Any,
    ) -> None: ...
    def equilibrate(self, *, depth_mm: float, dt_s: float = 0.0) -> int: ...
    def cut(self, *, from_mm: Sequence[float], to_mm: Sequence[float], depth_mm: float) -> None: ...
    def step(self, *, depth_mm: float, dt_s: float) -> int: ...
    def follow(self, *, depth_mm: float, seconds: float = 0.04, evaluations: int = 0, dt_s: float | None = None) -> Frame: ...
    @property
    def depth_m(self) -> float: ...
    @property
    def force_N(self) -> float: ...
    @property
    def base_force_N(self) -> float: ...
    @property
    def force_on_tool_N(self) -> _Floats: ...
    @property
    def moment_on_tool_Nm(self) -> _Floats: ...
    @property
    def displacement_m(self) -> _Floats: ...
    @property
    def nodal_parameter_m(self) -> _Floats: ...
    @property
    def positions_m(self) -> _Floats: ...
    @property
    def forces_N(self) -> _Floats: ...

class Error(Exception):
    fact: str
    where: str
    why: str
    remedy: str
    code: str
    def __init__(self, fact: str, where: str = "", why: str = "", remedy: str = "", code: str = "") -> None: ...

class UsageError(Error): ...
class InputError(Error): ...
class ModelError(Error): ...
class SolveError(Error): ...
class OutputError(Error): ...

class Stopped(KeyboardInterrupt):
    fact: str
    where: str
    why: str
    remedy: str
    code: str
    def __init__(self, fact: str, where: str = "", why: str = "", remedy: str = "", code: str = "") -> None: ...
