"""Dimple computes the force of an indentation from a segmented medical image, with a meshless method.

    import pydimple
    result = pydimple.run("brain.nrrd", label="left_hemisphere", mu_Pa=210, depth_mm=8)
    print(result)                             # the force and its band
    result.depth_m, result.force_N            # numpy arrays

`run` goes from an image to the force curve and its band, as the command `dimple run` does, to the same bits;
`build_model` and `solve` are its two halves, and `Session` moves a tool by hand. An image is a file or an array with
its affine. Options are keywords: the words of the command line's flags with their unit, ``--mu 300Pa`` is
``mu_Pa=300``. What is given is in the unit of its keyword; what comes back is in SI units, with the unit in its name,
and LPS. Failures are raised as `Error`, in five parts. What the program tells goes to ``logging.getLogger("pydimple")``.
"""

import difflib
import inspect
import json
import numbers
import os

import numpy as np

from . import _core
from ._core import Model, Result

__version__ = _core.version
__all__ = [
    "build_model",
    "solve",
    "run",
    "usable_places",
    "limit_threads",
    "Model",
    "Result",
    "Session",
    "Error",
    "UsageError",
    "InputError",
    "ModelError",
    "SolveError",
    "OutputError",
    "Stopped",
]


class _FiveParts:
    """What a message owes its reader."""

    def __init__(self, fact, where="", why="", remedy="", code=""):
        super().__init__(fact, where, why, remedy, code)
        self.fact, self.where, self.why, self.remedy, self.code = fact, where, why, remedy, code

    def __str__(self):
        parts = [("where", self.where), ("why", self.why), ("try", self.remedy), ("code", self.code)]
        return self.fact + "".join(f"\n  {name + ':':6} {text}" for name, text in parts if text)


class Error(_FiveParts, Exception):
    """A failure in five parts; each kind is a class of its own.

    Attributes
    ----------
    fact, where, why, remedy : str
        What is wrong, with numbers; stage, file or place; how it came about; what to do. Remedies name the flags of the
        command line: the keyword is the same word.
    code : str
        A word for programs, such as ``no-equilibrium``; apps/README.md lists those of the guards.
    """


class UsageError(Error):
    """An option or an argument makes no sense."""


class InputError(Error):
    """The image is unreadable or unusable."""


class ModelError(Error):
    """The model could not be built."""


class SolveError(Error):
    """The solution failed."""


class OutputError(Error):
    """Results could not be written."""


class Stopped(_FiveParts, KeyboardInterrupt):
    """A computation was ended by Ctrl-C. It is no `Error`, so that ``except pydimple.Error`` does not hold it back."""


_OPTIONS = {option["keyword"]: option for option in _core.options()}
_OF_SESSION = ("load.contact", "solver.precision", "solver.tolerance")


def _is_for_session(option):
    return option["key"].startswith("material.") or option["key"] in _OF_SESSION


# Which options each function takes.
_TAKES = {
    "build_model": lambda option: option["stage"] == "model",
    "usable_places": lambda option: option["stage"] == "model",
    "solve": lambda option: option["stage"] == "solve" or _is_for_session(option),
    "Session": _is_for_session,
    "run": lambda option: True,
}


def _text(where, keyword, value):
    """A value as the option table reads it, to the same bits."""
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
        f"{keyword} = {value!r} is not allowed",
        where,
        f"it is of type {type(value).__name__}",
        "give a number, a string, or a list of them",
        "usage",
    )


def _settings(where, config, tissue, options):
    given = []
    for keyword, value in options.items():
        option = _OPTIONS.get(keyword)
        if option is None:
            with_unit = [known for known in _OPTIONS if known.startswith(keyword + "_")]
            near = with_unit or difflib.get_close_matches(keyword, _OPTIONS, 1)
            raise UsageError(
                f"there is no option {keyword}" + (f", did you mean {near[0]}?" if near else ""),
                where,
                "options are the words of the command line's flags, with their unit",
                f"help(pydimple.{where}) lists those that it takes",
                "usage",
            )
        if not _TAKES[where](option):
            others = [name for name, takes in _TAKES.items() if takes(option) and name != where]
            raise UsageError(
                f"{where} takes no option {keyword}",
                where,
                f"it is for {', '.join(others)}",
                "give it there",
                "usage",
            )
        if value is not None:
            given.append((option["key"], _text(where, keyword, value), keyword))
    for label, differing in (tissue or {}).items():
        for name, value in differing.items():
            key = f"tissue.{label}.{name}"
            given.append((key, _text(where, key, value), f"tissue[{label!r}]"))
    return _core.Settings("" if config is None else os.fspath(config), given)


def _array(where, image):
    """A numpy array that the library can read where it is."""
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
            f"space = {space!r} is not allowed",
            where,
            "in one of the two patient spaces left and right, front and back are the other way round",
            'an affine of nibabel is space="RAS", one of ITK, SimpleITK or DICOM is space="LPS"',
            "usage",
        )
    matrix = np.array(affine, dtype=float)
    if matrix.shape != (4, 4) or not np.array_equal(matrix[3], [0, 0, 0, 1]):
        raise UsageError(
            f"the affine has shape {matrix.shape}" if matrix.shape != (4, 4) else f"the affine ends in {matrix[3]}",
            where,
            "it takes voxel numbers (i, j, k) to millimetres: 4 x 4, the last row 0 0 0 1",
            "give image.affine of nibabel, or directions times spacings beside the origin",
            "usage",
        )
    return np.diag([-1.0, -1.0, 1.0, 1.0]) @ matrix if space == "RAS" else matrix


def _with_image(where, image, affine, space, config, tissue, options):
    """Settings and, where the image is an array, the image."""
    is_file = isinstance(image, (str, bytes, os.PathLike))
    if is_file != (affine is None and space is None) or (affine is None) != (space is None):
        raise UsageError(
            "a file has an affine of its own" if is_file else "an array is given without affine and space",
            where,
            "where voxels lie, and which way is left, must be known once and for sure",
            "leave affine and space out"
            if is_file
            else 'give both: affine=image.affine, space="RAS" with nibabel',
            "usage",
        )
    settings = _settings(where, config, tissue, options)
    if is_file:
        settings.set("image.file", os.fsencode(image), "image")
        return settings, None
    names = options.get("label_names")
    return settings, _core.LabelImage(
        _array(where, image), _to_lps(where, affine, space), "" if names is None else os.fspath(names)
    )


def build_model(image, *, affine=None, space=None, config=None, tissue=None, **options):
    """Nodes, integration points, base and circle of a body, from an image: what `solve` and `Session` take."""
    settings, array = _with_image("build_model", image, affine, space, config, tissue, options)
    return _core.build(settings, array)


def usable_places(image, *, affine=None, space=None, config=None, **options):
    """Where the tool's circle may stand on an organ, as `dimple places` lists it, before any model is built.

    Each place says where the tool comes from (``from``, a side of the patient), the circle's centre (``centre_mm``, LPS),
    the way it moves (``push``), the side that the organ rests on then (``base``), the tissue beneath it along the push
    (``thickness_mm``), the tilt of the surface (``tilt_degrees``), the distance to the nearest fold or edge
    (``room_mm``), and a ``verdict``: good, doubtful (a run warns of it) or refused, with the ``reason``.
    """
    settings, array = _with_image("usable_places", image, affine, space, config, None, options)
    return json.loads(_core.usable_places_json(settings, array))


def solve(model, *, config=None, tissue=None, **options):
    """The force curve of a model, as `dimple solve` computes it.

    There is no band of the force: it takes a second cloud, which `run` makes.
    """
    return _core.solve(model, _settings("solve", config, tissue, options))


def run(image, *, affine=None, space=None, out=None, overwrite=False, config=None, tissue=None, **options):
    """From an image to the force curve with its band, as `dimple run` does: with the same options the same bits."""
    settings, array = _with_image("run", image, affine, space, config, tissue, options)
    if out is None:
        for keyword, value in options.items():
            if value is not None and _OPTIONS[keyword]["stage"] == "files":
                raise UsageError(
                    f"{keyword} is given and no folder",
                    "run",
                    "it is about files, and without out none are written",
                    f"add out=FOLDER, or leave {keyword} out",
                    "usage",
                )
        return _core.run_in_memory(settings, array)
    return _core.run_into_folder(settings, array, os.fsencode(out), bool(overwrite))


def limit_threads(count=None):
    """Lets all computations take at most so many threads from now on; None: as many as there are processors.

    Results do not depend on it. For programs that start several computations beside each other.
    """
    if count is not None and (not isinstance(count, numbers.Integral) or not 1 <= count <= 1024):
        raise UsageError(
            f"count = {count!r} is not allowed", "limit_threads", "it is no whole number from 1 to 1024", "give one", "usage"
        )
    _core.limit_threads(count if count is None else int(count))


class Session(_core.Session):
    """A body under a tool that someone moves, step by step.

    All is in memory; the model is its own. Several threads may ask it: one at a time is answered.
    """

    def __init__(self, model, *, config=None, tissue=None, **options):
        super().__init__(model, _settings("Session", config, tissue, options))


# Documentation and signatures of what takes options are made from the option table, which tells the command line too.
_IMAGE = """\
image : str, path or (I, J, K) array
    A file (.nrrd, .seg.nrrd, .nii, .nii.gz, .mha), or labels: whole numbers of any type, 0 is background. Arrays in C
    or Fortran order are read where they are; others, and those of foreign byte order, are copied once.
affine : (4, 4) array
    With an array: voxel (i, j, k) -> millimetres.
space : {"RAS", "LPS"}
    With an array: of its affine. nibabel's are RAS; those of ITK, SimpleITK and DICOM are LPS.
"""
_OUT = """\
out : str or path, optional
    Folder for all files that `dimple run` writes; without it nothing is written.
overwrite : bool
    Whether results that an earlier run left there are replaced.
"""
_CONFIG = """\
config : str or path, optional
    TOML file of options; keywords override it.
"""
_COMMON = _CONFIG + """\
tissue : dict, optional
    Labels with a material of their own, by number or name: ``{2: {"mu_Pa": 900}}``. `build_model` needs to know them
    too: integration cells are split where tissues meet.
"""


def _describe(function, where, before, returns, common=_COMMON):
    options = {k: o for k, o in _OPTIONS.items() if _TAKES[where](o)}
    listed = []
    for keyword, option in options.items():
        kind = {"float": "float", "int": "int", "list": "list"}.get(type(option["default"]).__name__, "str")
        default = "" if option["default"] in ("", []) else f", default {option['default']!r}"
        choices = f"; one of {', '.join(option['choices'])}" if option["choices"] else ""
        listed.append(f"{keyword} : {kind}{default}\n    {option['help']}{choices}")
    function.__doc__ = (
        inspect.cleandoc(function.__doc__) + "\n\nParameters\n----------\n" + before + common + "\n".join(listed)
        + (f"\n\nReturns\n-------\n{returns}\n" if returns else "\n")
    )
    plain = inspect.signature(function.__init__ if inspect.isclass(function) else function)
    own = [p for p in plain.parameters.values() if p.kind != p.VAR_KEYWORD and p.name != "self"]
    function.__signature__ = inspect.Signature(
        own + [inspect.Parameter(k, inspect.Parameter.KEYWORD_ONLY, default=o["default"]) for k, o in options.items()]
    )


_MODEL = "model : Model\n    Of `build_model`, or `Result.model`.\n"
_describe(build_model, "build_model", _IMAGE, "Model")
_describe(solve, "solve", _MODEL, "Result")
_describe(
    usable_places,
    "usable_places",
    _IMAGE,
    "dict\n    ``sides``: the highest place of each side; ``others``: more of the tool's own side; ``looked_at`` and\n"
    "    ``against``: places looked at there, and reasons against how many of them; ``warnings`` of the image.",
    _CONFIG,
)
_describe(run, "run", _IMAGE + _OUT, "Result")
_describe(Session, "Session", _MODEL, "")

for _public in (Model, Result):
    _public.__module__ = __name__
