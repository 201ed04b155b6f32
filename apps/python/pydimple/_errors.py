"""Errors in five parts, and the messages of the command line in the words of a Python caller.

The library's messages name flags (`--nodes`) and keys of a file of options (`cloud.nodes`). `in_keywords` replaces both
by keywords, with the option table and the tables below.
"""

import re

from . import _core


class _FiveParts:
    """Parts of a message."""

    def __init__(self, fact, where="", why="", remedy="", code=""):
        super().__init__(fact, where, why, remedy, code)
        self.fact, self.where, self.why, self.remedy, self.code = fact, where, why, remedy, code

    def __str__(self):
        parts = [("where", self.where), ("why", self.why), ("try", self.remedy), ("code", self.code)]
        return self.fact + "".join(f"\n  {name + ':':6} {text}" for name, text in parts if text)

    def __repr__(self):
        return f"<pydimple.{type(self).__name__}: {self.fact}>"


class Error(_FiveParts, Exception):
    """Failure in five parts, with a subclass for each kind.

    Attributes
    ----------
    fact, where, why, remedy : str
        The fact, with numbers; keyword, stage, file or place; the reason; the remedy.
    code : str
        Identifier for programs, such as ``no-equilibrium``; apps/guide/files.md lists those of the guards.
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
    """A computation was ended by Ctrl-C. It is no `Error`, so that ``except pydimple.Error`` does not catch it."""


for _kind in (Error, UsageError, InputError, ModelError, SolveError, OutputError, Stopped):
    _kind.__module__ = "pydimple"


def error_of(kind, fact, where, why, remedy, code):
    """Exception of a library error. A message about a file of options keeps the keys of that file."""
    of_file = bool(re.search(r"(, line \d+|\.toml)$", where))
    return globals()[kind](*(in_keywords(part, not of_file) for part in (fact, where, why, remedy)), code)


_OPTIONS = _core.options()
OF_FLAG = {option["flag"]: option for option in _OPTIONS if option["flag"]}
# Flags that are not in the option table.
OTHER_FLAGS = {
    "--output": "out=",
    "-o": "out=",
    "--force": "overwrite=True",
    "--config": "config=",
    "--resume": "`dimple run --resume`",  # also resumes a folder begun here
}
# Commands with a function here.
FUNCTIONS = {"dimple places": "pydimple.usable_places", "dimple options": "help(pydimple.run)"}

_OF_KEY = {option[name]: option for option in _OPTIONS for name in ("key", "key_without_unit")}
_SECTIONS = "|".join(sorted({option["key"].partition(".")[0] for option in _OPTIONS}))
_KEYS = rf"\((?:(?:{_SECTIONS})\.\w+(?:, )?)+\)"
_FLAG = re.compile(rf"(?<![\w-])(--[a-z][a-z-]*|-o\b)(?: (?={_KEYS})| (?!{_KEYS}|--)([^\s;:()]*[^\s;:().,]))?(?: ?{_KEYS})?")
_KEY = re.compile(rf"(?<![\w/.])((?:{_SECTIONS})\.\w+)(?: ?= ?([^\s;:()]*[^\s;:().,]))?")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?")
_SIDES_TOO = ("top", "bottom", "left", "right", "front", "back")  # of --base and --indent-at


def _is_value(option, text):
    """True if the text after a flag is its value, and not the next word of the sentence."""
    if _NUMBER.match(text) or text == "IMAGE":
        return True
    known = option["words"] + (list(_SIDES_TOO) if "superior" in option["words"] else [])
    return all(part in known for part in text.split(","))


def _one(option, text):
    number = _NUMBER.match(text)
    if number and text[number.end() :] in ("", option["unit"]):
        return number[0]
    return text if text == "IMAGE" else f'"{text}"'


def _given(option, text):
    """`keyword=value` in the syntax of Python."""
    parts = text.split(",")
    if len(parts) == 1:
        value = _one(option, text)
    elif isinstance(option["default"], list):
        value = f"[{', '.join(_one(option, part) for part in parts)}]"
    elif all(_NUMBER.fullmatch(part) for part in parts):
        value = f"({', '.join(parts)})"
    else:
        value = f'"{text}"'
    return f"{option['keyword']}={value}"


# Sections of options with names given by the caller.
KEYWORD_OF_SECTION = {
    "tissue": "tissue", "load.pressure": "pressures", "support": "supports", "step": "steps", "membrane": "membranes", "wall": "walls",
    "tool": "tools",
}  # fmt: skip


def _of_set(text):
    """`section.name` or `section.name=value` after --set."""
    key, _, value = text.partition("=")
    if key.startswith("tissue."):
        label, name = key[len("tissue.") :].rsplit(".", 1)
        option = _OF_KEY.get("material." + name)
        if option is None:
            return None
        return f'tissue={{{_one({"unit": ""}, label)}: {{"{option["keyword"]}": {_one(option, value)}}}}}'
    for section, keyword in KEYWORD_OF_SECTION.items():
        if key.startswith(section + ".") and key.count(".") > section.count(".") + 1:
            label, name = key[len(section) + 1 :].rsplit(".", 1)
            return f'{keyword}={{"{label}": {{"{name}": "{value}"}}}}'
    option = _OF_KEY.get(key)
    if option is None:
        return None
    return _given(option, value) if value else option["keyword"] + "="


def _of_flag(found):
    flag, value = found[1], found[2]
    option = OF_FLAG.get(flag)
    rest = "" if value is None else found[0][found.start(2) - found.start() - 1 : found.end(2) - found.start()]
    if flag == "--set" and value is not None:
        return _of_set(value) or found[0]
    if option is None:
        return OTHER_FLAGS[flag] + rest if flag in OTHER_FLAGS else found[0]
    if value is not None and _is_value(option, value):
        return _given(option, value)
    return option["keyword"] + "=" + rest


def _of_key(found):
    option, value = _OF_KEY.get(found[1]), found[2]
    if option is None:
        return found[0]
    if value is not None:
        return _given(option, value)
    return option["keyword"] + ("" if found.string[found.end() : found.end() + 1] == "'" else "=")


def in_keywords(text, keys_too=True):
    """Message with keywords in place of flags (and keys). Text in backquotes is a command."""
    said = []
    for part in re.split(r"(`[^`]*`)", text):
        if part.startswith("`"):
            command = part.strip("`").replace(" IMAGE", "")
            said.append(FUNCTIONS.get(command, part))
        else:
            part = _FLAG.sub(_of_flag, part)
            said.append(_KEY.sub(_of_key, part) if keys_too else part)
    return "".join(said)
