"""Makes the wheel: CMake compiles the extension; the type stubs are completed from the option table."""

import importlib.util
import inspect
import operator
import os
import pathlib
import re
import subprocess
import sys

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
# Existing build, relative to the root, that is used as it is: DIMPLE_BUILD=build/release.
GIVEN = os.environ.get("DIMPLE_BUILD")
BUILD = (ROOT / (GIVEN or "build/python")).resolve()
VERSION = re.search(r"project\(Dimple VERSION ([\d.]+)", (ROOT / "CMakeLists.txt").read_text()).group(1)


VECTORS = ("base", "direction")  # these also accept three numbers; other options with words accept any text


def typed(option):
    """Type of an option's keyword. Numbers with a unit are strings."""
    default, words = option["default"], option["words"]
    literal = "Literal[" + ", ".join(f'"{word}"' for word in words) + "]"
    if isinstance(default, (int, float)):
        return "float | str"
    if isinstance(default, list):
        return f"{literal} | Sequence[{literal}]" if words else "float | str | Sequence[float] | Sequence[str]"
    if option["choices"]:
        return literal
    if not words:
        return "str | float | Sequence[float]"  # a word, or x,y,z
    return f"{literal} | Sequence[float]" + ("" if option["keyword"] in VECTORS else " | str | os.PathLike[str]")


class CMakeBuild(build_ext):
    def build_extension(self, extension):
        made = BUILD / "python" / self.get_ext_filename("_core")
        if not GIVEN:
            self.spawn(
                ["cmake", "-S", str(ROOT), "-B", str(BUILD), "-G", "Ninja", "-D", "CMAKE_BUILD_TYPE=Release"]
                + ["-D", "DIMPLE_TESTS=OFF", "-D", "DIMPLE_PYTHON=ON", "-D", f"Python_EXECUTABLE={sys.executable}"]
            )
            self.spawn(["cmake", "--build", str(BUILD), "--target", "dimple_python"])
        elif not made.exists():
            raise SystemExit(
                f"{made} is not there: build the target dimple_python, with this Python, in {BUILD} first (make wheel does)"
            )
        package = pathlib.Path(self.get_ext_fullpath(extension.name)).resolve().parent
        package.mkdir(parents=True, exist_ok=True)
        self.copy_file(str(made), str(package / made.name))
        self.complete_stubs(made, package / "__init__.pyi")

    def complete_stubs(self, made, stubs):
        """Replaces `**options` of each function by the keywords that it accepts."""
        sys.path.insert(0, str(stubs.parent.parent))
        import pydimple

        text = (HERE / "pydimple" / "__init__.pyi").read_text()
        for name in ("build_model", "usable_places", "solve", "run", "Session", "Organ", "Organ.build_model", "Organ.usable_places"):
            thing = operator.attrgetter(name)(pydimple)
            keywords = ", ".join(
                f"{p.name}: {typed(pydimple._OPTIONS[p.name])} | None = ..."
                for p in inspect.signature(thing).parameters.values()
                if p.name in pydimple._OPTIONS
            )
            owner, _, method = name.rpartition(".")
            start = text.index(f"class {owner}:") if owner else 0
            start = text.index(f"class {name}:" if inspect.isclass(thing) else f"def {method}(", start)
            by_name = "self, *, " if "." in name else ""  # no argument precedes them
            text = text[:start] + re.sub(rf"({'self, ' if by_name else ''})\*\*options: Any", by_name + keywords, text[start:], count=1)
        stubs.write_text(text)


setup(
    version=VERSION,
    packages=["pydimple"],
    package_data={"pydimple": ["py.typed", "__init__.pyi"]},
    ext_modules=[Extension("pydimple._core", sources=[])],
    cmdclass={"build_ext": CMakeBuild},
    # Intermediate files go to the build folder, not among the sources.
    options={"build": {"build_base": str(BUILD / "wheel")}, "egg_info": {"egg_base": str(BUILD)}},
)
