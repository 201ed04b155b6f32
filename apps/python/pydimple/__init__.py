"""Dimple computes the force of an indentation from a segmented medical image, with a meshless method.

    import pydimple
    result = pydimple.run("brain.nrrd", label="left_hemisphere", mu_Pa=210, depth_mm=8)
    print(result)                             # the force and its error bounds
    result.depth_m, result.force_N            # numpy arrays

`run` goes from an image to the force curve and its error bounds, as the command `dimple run` does, to the same bits;
`build_model` and `solve` are its two halves, `Organ` reads an image once for models at several places, and `Session`
moves a tool by hand. An image is a file or an array with
its affine. Options are keywords: the words of the command line's flags with their unit, ``--mu 300Pa`` is
``mu_Pa=300``. What is given is in the unit of its keyword; what comes back has its unit in its name, mostly SI, and is
LPS. Failures are raised as `Error`, in five parts. Log lines go to ``logging.getLogger("pydimple")``.
"""

import dataclasses
import difflib
import inspect
import json
import numbers
import os

import numpy as np

from . import _core, _errors
from ._core import Model, Result
from ._errors import Error, InputError, ModelError, OutputError, SolveError, Stopped, UsageError

__version__ = _core.version
__all__ = [
    "build_model",
    "solve",
    "run",
    "usable_places",
    "limit_threads",
    "Model",
    "Organ",
    "Result",
    "Band",
    "Session",
    "Frame",
    "Error",
    "UsageError",
    "InputError",
    "ModelError",
    "SolveError",
    "OutputError",
    "Stopped",
]


def __dir__():
    return sorted(name for name in globals() if name in __all__ or name.startswith("__"))


_OPTIONS = {option["keyword"]: option for option in _core.options()}
# The depth is that at which supports have reached their full displacement.
_OF_SESSION = ("load.contact", "load.gravity", "load.depth_mm", "solver.precision", "solver.tolerance")


def _is_for_session(option):
    return option["key"].startswith("material.") or option["key"] in _OF_SESSION


def _shapes_the_surface(option):
    return option["key"].startswith("image.") or option["key"] == "boundary.indenter_diameter_mm"


# Arguments of run that are not in the option table; other functions may lack them.
_OF_RUN = ("tissue", "pressures", "supports", "steps", "membranes", "walls", "tools")

# Options that each function accepts.
_TAKES = {
    "build_model": lambda option: option["stage"] == "model",
    "usable_places": lambda option: option["stage"] == "model",
    "solve": lambda option: option["stage"] == "solve" or option["key"].startswith("accuracy.") or _is_for_session(option),
    "Session": _is_for_session,
    "run": lambda option: True,
    "Organ": lambda option: option["stage"] == "model",
    "Organ.build_model": lambda option: option["stage"] == "model" and not _shapes_the_surface(option),
    "Organ.usable_places": lambda option: option["key"].startswith("boundary.") and not _shapes_the_surface(option),
}


def _text(where, keyword, value):
    """Value as text for the option table, without loss."""
    if isinstance(value, str):
        return value
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, numbers.Integral) and not isinstance(value, bool):
        return str(int(value))
    if isinstance(value, numbers.Real) and not isinstance(value, bool):
        return repr(float(value))
    if isinstance(value, (list, tuple, np.ndarray)):
        return ",".join(_text(where, keyword, item) for item in value)
    raise UsageError(
        f"{keyword}={value!r} is not allowed",
        where,
        f"it is of type {type(value).__name__}",
        "give a number, a string, or a list of them",
        "usage",
    )


def _settings(where, config, named, options):
    given = []
    for keyword, value in options.items():
        option = _OPTIONS.get(keyword)
        if option is None and keyword in _OF_RUN:
            raise UsageError(f"{where} has no option {keyword}", where, "it is for run", "give it there", "usage")
        if option is None:
            taken = [known for known, its in _OPTIONS.items() if _TAKES[where](its)]
            with_unit = [known for known in taken if known.startswith(keyword + "_")]
            near = with_unit or difflib.get_close_matches(keyword, taken, 1)
            raise UsageError(
                f"there is no option {keyword}" + (f", did you mean {near[0]}?" if near else ""),
                where,
                "options are words with their unit",
                f"help(pydimple.{where}) lists its options",
                "usage",
            )
        if not _TAKES[where](option):
            others = [name for name, takes in _TAKES.items() if takes(option) and name != where]
            raise UsageError(
                f"{where} has no option {keyword}",
                where,
                f"it is for {', '.join(others)}",
                "give it there",
                "usage",
            )
        if value is not None:
            given.append((option["key"], _text(where, keyword, value), keyword + "="))
    for section, members in named.items():
        for label, its in (members or {}).items():
            for name, value in its.items():
                key = f"{section}.{label}.{name}"
                given.append((key, _text(where, key, value), f"{_errors.KEYWORD_OF_SECTION[section]}[{label!r}]"))
    return _core.Settings("" if config is None else os.fspath(config), given)


def _named(tissue, pressures, supports, steps=None, membranes=None, walls=None, tools=None):
    """Sections of options with names given by the caller."""
    return {
        "tissue": tissue, "load.pressure": pressures, "support": supports, "step": steps, "membrane": membranes, "wall": walls,
        "tool": tools,
    }  # fmt: skip


def _array(where, image):
    """Numpy array that the library can read without a copy."""
    if np.ma.isMaskedArray(image) and np.ma.is_masked(image):
        raise UsageError(
            "the image is an array with masked voxels",
            where,
            "a masked voxel is neither organ nor background",
            "fill them with a label: image.filled(0)",
            "usage",
        )
    array = np.asarray(image)
    if array.ndim != 3 or array.dtype.kind not in "biuf" or array.dtype.itemsize not in (1, 2, 4, 8):
        raise UsageError(
            f"the image is an array of {array.ndim} axes, of type {array.dtype}",
            where,
            "a segmentation has three axes and whole numbers",
            "give a file, or an array of labels: np.asarray(image.dataobj) of a nibabel image",
            "usage",
        )
    if array.dtype.kind == "f" and array.dtype.itemsize == 2:
        array = array.astype(np.float32)
    if array.dtype.kind == "b":
        array = array.view(np.uint8)
    if not array.dtype.isnative:
        array = array.astype(array.dtype.newbyteorder("="))
    if not (array.flags.c_contiguous or array.flags.f_contiguous):
        array = np.ascontiguousarray(array)
    return array


def _to_lps(where, affine, space):
    if space not in ("RAS", "LPS"):
        raise UsageError(
            f"space={space!r} is not allowed",
            where,
            "RAS and LPS differ in the signs of the first two axes",
            'an affine of nibabel is space="RAS", one of ITK, SimpleITK or DICOM is space="LPS"',
            "usage",
        )
    matrix = np.array(affine, dtype=float)
    if matrix.shape != (4, 4) or not np.array_equal(matrix[3], [0, 0, 0, 1]):
        raise UsageError(
            f"the affine has shape {matrix.shape}" if matrix.shape != (4, 4) else f"the affine ends in {matrix[3]}",
            where,
            "it maps voxel numbers (i, j, k) to millimetres: 4 x 4, the last row 0 0 0 1",
            "give image.affine of nibabel, or directions times spacings next to the origin",
            "usage",
        )
    return np.diag([-1.0, -1.0, 1.0, 1.0]) @ matrix if space == "RAS" else matrix


def _with_image(where, image, affine, space, config, named, options):
    """Settings and, if it is an array, the image."""
    is_file = isinstance(image, (str, bytes, os.PathLike))
    if is_file and not os.fspath(image):
        raise UsageError("the image is named ''", where, "there is nothing to work on", "give a file or an array", "usage")
    if is_file != (affine is None and space is None) or (affine is None) != (space is None):
        raise UsageError(
            "a file has an affine of its own" if is_file else "an array is given without affine and space",
            where,
            "the place and orientation of the voxels must be given exactly once",
            "leave affine and space out"
            if is_file
            else 'give both: affine=image.affine, space="RAS" with nibabel',
            "usage",
        )
    settings = _settings(where, config, named, options)
    if is_file:
        settings.set("image.file", os.fsencode(image), "image")
        return settings, None
    names = options.get("label_names")
    return settings, _core.LabelImage(
        _array(where, image), _to_lps(where, affine, space), "" if names is None else os.fspath(names)
    )


def build_model(image, *, affine=None, space=None, config=None, tissue=None, supports=None, **options):
    """Nodes, integration points, base and contact patch of a body, from an image: input of `solve` and `Session`."""
    settings, array = _with_image("build_model", image, affine, space, config, {"tissue": tissue, "support": supports}, options)
    return _core.build(settings, array)


def usable_places(image, *, affine=None, space=None, config=None, **options):
    """Usable places of the tool on an organ, as `dimple places` lists them, before any model is built.

    Each place has the side of the patient from which the tool approaches (``from``), the centre of the contact patch
    (``centre_mm``, LPS), the approach direction (``push``), the side on which the organ then rests (``base``), the tissue
    beneath it (``thickness_mm``), the tilt of the surface (``tilt_degrees``), the distance to the nearest fold or edge
    (``room_mm``), and a ``verdict``: good, doubtful (a run warns of it) or refused, with the ``reason``.
    """
    settings, array = _with_image("usable_places", image, affine, space, config, {}, options)
    return _places(_core.usable_places_json(settings, array))


def _places(text):
    found = json.loads(text)
    found["warnings"] = [_errors.in_keywords(warning) for warning in found["warnings"]]
    return found


def solve(model, *, config=None, tissue=None, pressures=None, supports=None, steps=None, membranes=None, walls=None, tools=None, **options):
    """The force curve of a model with its error bounds.

    With an accuracy (``accuracy="2%"``, or a time for it, ``budget_s=60``) the organ of the model is discretised with more
    and more nodes until the error is small enough. The result, to the same bits, is that of `run` with the same accuracy,
    and `Result.model` has the final nodes. The number of nodes of the given model is then not used.
    """
    return _core.solve(model, _settings("solve", config, _named(tissue, pressures, supports, steps, membranes, walls, tools), options))


def run(
    image, *, affine=None, space=None, out=None, overwrite=False, config=None, tissue=None, pressures=None, supports=None, steps=None,
    membranes=None, walls=None, tools=None, **options
):
    """From an image to the force curve with its error bounds, as `dimple run`: with the same options the same bits."""
    settings, array = _with_image("run", image, affine, space, config, _named(tissue, pressures, supports, steps, membranes, walls, tools), options)
    if out is None:
        for keyword, value in options.items():
            if value is not None and _OPTIONS[keyword]["stage"] == "files":
                raise UsageError(
                    f"{keyword} is given and no folder",
                    "run",
                    "it concerns files, and none are written without out",
                    f"add out=FOLDER, or leave {keyword} out",
                    "usage",
                )
        if overwrite:
            raise UsageError(
                "overwrite is given and no folder",
                "run",
                "nothing is written without out",
                "add out=FOLDER, or leave overwrite out",
                "usage",
            )
        return _core.run_in_memory(settings, array)
    return _core.run_into_folder(settings, array, os.fsencode(out), bool(overwrite))


def limit_threads(count=None):
    """Limits the threads of all computations from now on; None: the number of processors.

    Results do not depend on it. For programs that start several computations at once.
    """
    if count is not None and (not isinstance(count, numbers.Integral) or not 1 <= count <= 1024):
        raise UsageError(
            f"count={count!r} is not allowed", "limit_threads", "it is no whole number from 1 to 1024", "give one", "usage"
        )
    _core.limit_threads(count if count is None else int(count))


class Organ(_core.Organ):
    """Organ that is read once, for models at several positions.

    The image is read and the surface made here; `build_model` discretises the organ for one position after the other. Its
    models have the same bits as those of `pydimple.build_model` with the same options.
    """

    def __init__(self, image, *, affine=None, space=None, config=None, tissue=None, supports=None, **options):
        super().__init__(*_with_image("Organ", image, affine, space, config, {"tissue": tissue, "support": supports}, options))

    def build_model(self, **options):
        """Nodes, integration points, base and contact patch, with these options in addition to those of the organ."""
        return _core.build_of_organ(self, _settings("Organ.build_model", None, {}, options))

    def usable_places(self, **options):
        """Usable places of the tool, as from `pydimple.usable_places`."""
        return _places(_core.places_of_organ(self, _settings("Organ.usable_places", None, {}, options)))


@dataclasses.dataclass(frozen=True, repr=False, eq=False)
class Band:
    """Error bounds of the force: discretisation error only.

    Attributes
    ----------
    low_N, high_N : (S,) float64 array
        Lower and upper bound, newtons, at each sample of the force curve.
    """

    low_N: np.ndarray
    high_N: np.ndarray

    def __repr__(self):
        edges = " to ".join(_core.force_in_words(edge[-1]) for edge in (self.low_N, self.high_N))
        return f"<pydimple.Band: {edges} at the end>"


@dataclasses.dataclass(frozen=True, repr=False)
class Frame:
    """Pose and force of a live tool. Returned by `Session.follow`.

    Attributes
    ----------
    asked_mm, depth_mm : float
        Requested and actual depth below first contact, along the approach direction, millimetres.
    force_N, error_N : float
        On the tool along its approach direction, positive where the tissue resists; and its largest distance from the
        force of equilibrium at the requested depth: infinite if unknown.
    error_at_depth_N : float
        Largest error compared with the equilibrium at ``depth_mm``.
    force_on_tool_N, moment_on_tool_Nm : tuple of three floats
        Force vector on the tool, LPS, and its moment about the centre of the contact patch.
    force_direction, moment_arm_m : tuple of three floats
        These two divided by ``force_N``; without a force, those at the least known depth, or zeros.
    stiffness_N_per_m : float
        Derivative of the force by the depth.
    residual : float
        Unbalanced force, relative, as the option ``tolerance``.
    evaluations : int
        Force evaluations of the frame.
    status : {"there", "lags", "stopped", "elsewhere", "beyond"}
        The tool is at the requested pose; moves there in the next frames; stays, as no deeper equilibrium was found; is at
        another pose than requested (sockets and scripts only); or the requested depth exceeds the body. ``lags`` ends
        within 100 frames, or 300 evaluations, in which the tool comes no nearer.
    """

    asked_mm: float
    depth_mm: float
    force_N: float
    error_N: float
    error_at_depth_N: float
    force_on_tool_N: tuple
    moment_on_tool_Nm: tuple
    force_direction: tuple
    moment_arm_m: tuple
    stiffness_N_per_m: float
    residual: float
    evaluations: int
    status: str

    def __repr__(self):
        title = _core.force_title(self.force_N, self.depth_mm)
        error = "unknown" if self.error_N == float("inf") else _core.force_in_words(self.error_N)
        return f"<pydimple.Frame: {title}, error {error}, {self.status}>"


class Session(_core.Session):
    """A body under a tool that the caller moves, step by step.

    All is in memory; the model is its own. Several threads may call it: one at a time is served.
    """

    def __init__(self, model, *, config=None, tissue=None, pressures=None, supports=None, **options):
        super().__init__(model, _settings("Session", config, _named(tissue, pressures, supports), options))

    def follow(self, *, depth_mm, seconds=0.04, evaluations=0, dt_s=None):
        """Moves the tool towards a depth and computes the body for at most the time of a frame.

        If that does not suffice the tool lags, and the next call continues from there. No state far from equilibrium is
        shown: the last good one remains. Lifted (0 and less) the body is at rest; tissue that relaxes pulls a bonded tool
        at 0 until it is lifted (below 0), which resets the history of the tissue.

        Parameters
        ----------
        depth_mm : float
            Depth of the tool below first contact, along its approach direction, millimetres.
        seconds : float
            Time for the frame.
        evaluations : int
            Force evaluations, at most; then no clock is read, and the same calls give the same bits on any machine. 0: use
            `seconds`.
        dt_s : float, optional
            Since the last frame, seconds: viscoelastic tissue relaxes for this time. Without it `seconds`.

        Returns
        -------
        Frame

        Raises
        ------
        SolveError
            The model's scheme has no live tool (``scheme="horton2007"``).
        """
        return Frame(*_core.follow(self, depth_mm, seconds, evaluations, seconds if dt_s is None else dt_s))


# Documentation and signatures with options are made from the option table, as is the command line.
_IMAGE = """\
image : str, path or (I, J, K) array
    File (.nrrd, .seg.nrrd, .nii, .nii.gz, .mha), or labels: integers of any type, 0 is background. Arrays in C or
    Fortran order are read in place; others, and those of foreign byte order, are copied once.
affine : (4, 4) array
    With an array: map from voxel (i, j, k) to millimetres.
space : {"RAS", "LPS"}
    With an array: space of its affine. That of nibabel is RAS, that of ITK, SimpleITK and DICOM is LPS.
"""
_OUT = """\
out : str or path, optional
    Folder for all files that `dimple run` writes; without it nothing is written.
overwrite : bool
    Whether results of an earlier run there are replaced.
"""
_CONFIG = """\
config : str or path, optional
    TOML file of options; keywords override it.
"""
_COMMON = _CONFIG + """\
tissue : dict, optional
    Labels with their own material, by number or name: ``{2: {"mu_Pa": 900}}``. `build_model` needs them too:
    integration cells are split where tissues meet.
"""
_SUPPORTS = """\
supports : dict, optional
    Parts of the body held in addition to the base, or moved in addition to the tool, by names of your own:
    ``{"retractor": {"on": "left", "move_mm": (3, 0, 0)}}``. `build_model` needs those on the tissue of a label.
    In a `Session` their displacement is complete when the tool is at ``depth_mm``.
"""
_PRESSURES = """\
pressures : dict, optional
    Pressures on parts of the surface, by names of your own: ``{"csf": {"pressure_Pa": 500, "on": "superior"}}``.
"""
_LOADED = _COMMON + _PRESSURES + _SUPPORTS
_STEPS = """\
steps : dict, optional
    Steps of the load in their order, by names of your own: ``{"press": {"move_mm": 4}, "pull": {"moves": "retractor",
    "move_mm": (3, 0, 0)}}``. One number moves the tool along its approach direction; three are x, y, z in LPS.
"""


def _describe(function, where, before, returns, common=_COMMON):
    options = {k: o for k, o in _OPTIONS.items() if _TAKES[where](o)}
    listed = []
    for keyword, option in options.items():
        kind = {"float": "float", "int": "int", "list": "list"}.get(type(option["default"]).__name__, "str")
        default = "" if option["default"] in ("", []) else f", default {option['default']!r}"
        choices = f"; one of {', '.join(option['choices'])}" if option["choices"] else ""
        listed.append(f"{keyword} : {kind}{default}\n    {_errors.in_keywords(option['help'])}{choices}")
    function.__doc__ = (
        inspect.cleandoc(function.__doc__) + "\n\nParameters\n----------\n" + before + common + "\n".join(listed)
        + (f"\n\nReturns\n-------\n{returns}\n" if returns else "\n")
    )
    plain = inspect.signature(function.__init__ if inspect.isclass(function) else function)
    own = [p for p in plain.parameters.values() if p.kind != p.VAR_KEYWORD]
    if inspect.isclass(function):
        own = own[1:]
    function.__signature__ = inspect.Signature(
        own + [inspect.Parameter(k, inspect.Parameter.KEYWORD_ONLY, default=o["default"]) for k, o in options.items()]
    )


_MODEL = "model : Model\n    From `build_model`, or `Result.model`.\n"
_describe(build_model, "build_model", _IMAGE, "Model", _COMMON + _SUPPORTS)
_describe(solve, "solve", _MODEL, "Result", _LOADED + _STEPS)
_describe(
    usable_places,
    "usable_places",
    _IMAGE,
    "dict\n    ``sides``: the highest place of each side; ``others``: more of the tool's own side; ``looked_at`` and\n"
    "    ``against``: number of places examined there, and of each reason against them; ``warnings`` of the image.",
    _CONFIG,
)
_describe(run, "run", _IMAGE + _OUT, "Result", _LOADED + _STEPS)
_describe(Session, "Session", _MODEL, "", _LOADED)
_describe(Organ, "Organ", _IMAGE, "", _COMMON + _SUPPORTS)
_describe(Organ.build_model, "Organ.build_model", "", "Model", "")
_describe(Organ.usable_places, "Organ.usable_places", "", "dict\n    As from `pydimple.usable_places`.", "")

for _public in (Model, Result):
    _public.__module__ = __name__
