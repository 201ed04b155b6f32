"""Common parts of the studies: options of the command line, the folder of results, the program `dimple`, and pictures."""

import argparse
import logging
import os
import pathlib
import re
import shutil
import sys
import textwrap

import pydimple
from pydimple import _core

# In the order of the table that the command line is made from.
_TABLE = {option["key"]: option for option in _core.options()}
_UNIT = re.compile(r"_(mm_per_s|kg_per_m3|per_s|percent|mm|Pa|s)$")
_CODES = {
    pydimple.UsageError: 2,
    pydimple.InputError: 3,
    pydimple.ModelError: 4,
    pydimple.SolveError: 5,
    pydimple.OutputError: 6,
}


class Refused(Exception):
    """Refusal by a study: its words, and the exit code that `dimple` has for such a mistake."""


def refuse(words, code=2):
    raise Refused(words, code)


def key_of(word):
    """Full key of an option given as "mu", "--mu", "material.mu" or "material.mu_Pa"; the word itself if it is none."""
    word = word.lstrip("-").replace("-", "_")
    for key, option in _TABLE.items():
        names = {key, option["keyword"]}
        if option["unit"]:
            names |= {_UNIT.sub("", name) for name in names}
        if word in names:
            return key
    return word


class Case:
    """An image and the options given for it: key -> text. Nothing is computed until requested."""

    def __init__(self, image="", given=None):
        self.image = str(image)
        self.given = {key: text_of(value) for key, value in (given or {}).items()}

    def having(self, settings, image=None):
        return Case(self.image if image is None else image, {**self.given, **settings})

    def settings(self):
        settings = _core.Settings("", [(key, text, key) for key, text in self.given.items()])
        if self.image:
            settings.set("image.file", self.image, "image")
        return settings

    def run(self):
        """Runs the case in memory; returns a pydimple.Result."""
        return _core.run_in_memory(self.settings(), None)

    def values(self):
        """Values by key, in the unit of the key. Raises UsageError for an unknown option or an invalid value."""
        return Case("", self.given).settings().values()

    def arguments(self):
        """Options that differ from the defaults, as arguments of `dimple run IMAGE`."""
        order = {key: k for k, key in enumerate(_TABLE)}
        words = []
        for key in sorted(self.given, key=lambda key: (order.get(key, len(order)), key)):
            default = _TABLE.get(key, {}).get("default")
            if self.given[key] != text_of(default) and not _same_number(self.given[key], default):
                words += ["--set", f"{key}={self.given[key]}"]
        return words


def _same_number(text, default):
    try:
        return float(text) == default
    except ValueError:
        return False


def text_of(value):
    """Text of a value as the option table reads it, to the same bits: 10 and not 10.0."""
    if isinstance(value, (list, tuple)):
        return ",".join(text_of(part) for part in value)
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e15:
        return str(int(value))
    return value if isinstance(value, str) else repr(value)


def words(text):
    return [word for word in text.split(",") if word]


def whole_numbers(text):
    return [int(word) for word in words(text)]


def parser(name, description, flags=False):
    """Parser with the options of all studies; with `flags` also those of `dimple run`, as --set has them."""
    result = argparse.ArgumentParser(prog=f"python3 tests/studies/{name}.py", description=description, allow_abbrev=False)
    result.add_argument("image", nargs="?", default="", metavar="IMAGE", help="label image")
    result.add_argument("-o", "--out", default="", metavar="FOLDER", help="for the results")
    result.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="any option, as section.key=value")
    result.add_argument("--threads", type=int, help="at most this many; results do not depend on it")
    result.add_argument("-q", "--quiet", action="store_true", help="errors only")
    for key, option in _TABLE.items() if flags else ():
        word = _UNIT.sub("", option["keyword"]) if option["unit"] else option["keyword"]
        result.add_argument("--" + word.replace("_", "-"), dest=key, help=argparse.SUPPRESS)
    return result


def known_words(given, known, where):
    for word in given:
        if word not in known:
            refuse(f"{where}: '{word}' is not known, but {', '.join(known)}")


def _case(options):
    given = {}
    for pair in options.set:
        key, equals, text = pair.partition("=")
        if not equals:
            refuse(f"--set: '{pair}' is not key=value")
        given[key_of(key)] = text
    given |= {key: text for key, text in vars(options).items() if key in _TABLE and text is not None}
    case = Case(options.image, given)
    values = case.values()
    for key in ("accuracy.goal", "accuracy.budget_s"):
        if values[key]:
            refuse(f"a study takes no accuracy, since it chooses the numbers of nodes itself: leave {key} out")
    return case


def main(of, study, argv=None):
    """Runs `study(case, options, say)` from its command line; returns the exit code of `dimple` for such an end."""
    options = of.parse_args(argv)
    logging.getLogger("pydimple").addHandler(logging.NullHandler())  # the output of each run would hide that of the study
    say = (lambda line: None) if options.quiet else (lambda line: print(line, file=sys.stderr, flush=True))
    try:
        if options.threads:
            pydimple.limit_threads(options.threads)
        print(study(_case(options), options, say))
        return 0
    except KeyboardInterrupt as stop:  # pydimple.Stopped too
        print(f"interrupted{': ' + str(stop.args[0]) if stop.args else ''}", file=sys.stderr)
        return 130
    except Refused as refused:
        print(refused.args[0], file=sys.stderr)
        return refused.args[1]
    except pydimple.Error as error:
        print(error, file=sys.stderr)
        return _CODES.get(type(error), 1)


def folder_for(out, own):
    """Folder of the results, which write() makes. Refused if it is impossible, or holds files and none is `own`."""
    folder = pathlib.Path(out)
    if not out:
        refuse("no folder for the results was given: -o FOLDER")
    there = next(place for place in [folder, *folder.absolute().parents] if place.exists() or place.is_symlink())
    if not there.is_dir() or not os.access(there, os.W_OK):
        refuse(f"{folder} cannot be made or written to", 6)
    if folder.is_dir() and any(folder.iterdir()) and not (folder / own).exists():
        refuse(f"{folder} holds files that are not results of this study: give an empty or a new folder", 6)
    return folder


def _whole(file, make):
    """Writes a file with `make(part)`; it appears under its name only when complete."""
    part = file.with_name(f".part.{file.name}")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        make(part)
        os.replace(part, file)
    except OSError as error:
        part.unlink(missing_ok=True)
        refuse(f"{file} cannot be written: {error}", 6)
    except KeyboardInterrupt:
        part.unlink(missing_ok=True)
        raise


def write(file, text):
    _whole(file, lambda part: part.write_text(text, encoding="utf-8"))


def quoted(text):
    """Field of a table: in quotes, and not a formula of a spreadsheet."""
    return '"' + ("'" if text[:1] in ("=", "+", "-", "@") else "") + text.replace('"', '""') + '"'


def shortest(value):
    """Shortest text that reads back to the same bits."""
    return text_of(float(value))


def program():
    """Path of the command `dimple`: DIMPLE_PROGRAM, or on the path."""
    name = os.environ.get("DIMPLE_PROGRAM", "dimple")
    found = shutil.which(name)
    if not found:
        refuse(f"there is no program {name}: build it, and say where by DIMPLE_PROGRAM=build/release/dimple")
    return os.path.abspath(found)


def forces_at(depth_mm, force_N, at_mm):
    """Forces at these depths, interpolated between samples, as far as they reach."""
    import numpy as np

    reached = [d for d in at_mm if len(depth_mm) and d <= depth_mm[-1] * (1 + 1e-9)]
    return list(np.interp(reached, depth_mm, force_N)) if reached else []


def reference_at(file, at_mm=None):
    """force_N of a CSV at each of the depths. Without depths: at 1, 2, ... mm, as many as it has, to 8 mm at most."""
    import csv

    try:
        with open(file, newline="", encoding="utf-8") as opened:
            known = {float(row["indentation_mm"]): float(row["force_N"]) for row in csv.DictReader(opened)}
    except (OSError, KeyError, TypeError, ValueError) as error:
        refuse(f"{file} is no table with the columns indentation_mm,force_N: {error}", 3)

    def at(d):
        return next((force for depth, force in known.items() if abs(depth - d) < 1e-6), None)

    wanted = at_mm
    if wanted is None:
        wanted = [1.0]
        while len(wanted) < 8 and at(len(wanted) + 1) is not None:
            wanted.append(len(wanted) + 1.0)
    for d in wanted:
        if at(d) is None:
            refuse(f"the reference has no force at {d:.4g} mm", 3)
    return [at(d) for d in wanted]


def in_words(force_N):
    return f"{force_N:.4g} N" if abs(force_N) >= 0.1 else f"{1e3 * force_N:.4g} mN"


def pyplot():
    """matplotlib without a screen. The same input gives the same bytes, and an SVG has its texts as text."""
    try:
        import matplotlib
    except ImportError:
        refuse("matplotlib is not installed: apt install python3-matplotlib")
    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    plt.rcParams.update(
        {
            "svg.fonttype": "none",
            "svg.hashsalt": "dimple",
            "font.size": 9,
            "axes.grid": True,
            "grid.color": "#e4e7eb",
            "axes.axisbelow": True,
            "legend.frameon": False,
        }
    )
    return plt


HUES = ["#0072b2", "#d55e00", "#009e73", "#b5588f", "#8c6d1f", "#4a4e54", "#000000", "#6a3d9a"]


def headed(axes, title, lines=()):
    """Writes a panel's title, and below it the information needed to read it."""
    lines = [part for line in lines for part in textwrap.wrap(line, 130)]
    axes.set_title("\n".join(lines), fontsize=7, color="#555b66", loc="left")
    axes.annotate(title, (0, 1), (0, 8 + 9 * len(lines)), "axes fraction", "offset points", fontsize=11, weight="bold")


def logarithmic(axes):
    """Makes both axes logarithmic, with ticks such as 0.5 and 20 and no powers of ten."""
    from matplotlib import ticker

    axes.set(xscale="log", yscale="log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(ticker.LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter(ticker.FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(ticker.NullFormatter())


def save(figure, folder, name):
    for suffix, metadata in (("png", {"Software": None}), ("svg", {"Date": None})):
        _whole(folder / f"{name}.{suffix}", lambda part: figure.savefig(part, dpi=110, bbox_inches="tight", metadata=metadata))
