"""YAML text to plain values, remembering where each key and value stands.

pyyaml reads YAML 1.1, in which `off` is a boolean and `1e3` is a text. Both are refused here with
the spelling that says what was meant, instead of being handed on as a surprise.
"""

import re
from collections.abc import Hashable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import yaml
from yaml.constructor import ConstructorError

from config.documents.problems import Key, Problem, did_you_mean_file, key_path

Location = tuple[Key, ...]

_MERGE_TAG = "tag:yaml.org,2002:merge"
_BOOL_TAG = "tag:yaml.org,2002:bool"
_INT_TAG = "tag:yaml.org,2002:int"
_FLOAT_TAG = "tag:yaml.org,2002:float"
_STR_TAG = "tag:yaml.org,2002:str"
_NULL_TAG = "tag:yaml.org,2002:null"
_COLLECTION_TAGS = {"tag:yaml.org,2002:map", "tag:yaml.org,2002:seq"}
_PLAIN_TAGS = {_BOOL_TAG, _INT_TAG, _FLOAT_TAG, _STR_TAG, _NULL_TAG}

_VALUES_AT_MOST = 100_000  # aliases of aliases grow without end

_NUMBER_READ_AS_TEXT = re.compile(r"[-+]?(\d[\d_]*\.?[\d_]*|\.\d[\d_]*)[eE][-+]?\d+|0o[0-7]+")


@dataclass
class YamlDocument:
    """One parsed file: its plain values, where they stand, and what could not be read."""

    file: str
    value: object
    problems: list[Problem] = field(default_factory=list)
    marks: dict[Location, tuple[yaml.Mark, yaml.Mark]] = field(default_factory=dict)

    def problem(self, location: Location, message: str, *, at_key: bool = False) -> Problem:
        """A problem at the value (or the key) of `location`, or at its nearest existing parent."""
        for length in range(len(location), -1, -1):
            if location[:length] in self.marks:
                key_mark, value_mark = self.marks[location[:length]]
                mark = key_mark if at_key or length < len(location) else value_mark
                line, column = mark.line + 1, mark.column + 1
                return Problem(self.file, line, column, key_path(location), message)
        return Problem(self.file, 1, 1, key_path(location), message)


def read_yaml(path: Path) -> YamlDocument:
    """Read a file of one YAML document. Never raises for a bad file: see `problems`."""
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        return _unreadable(path, f"{error.strerror}{did_you_mean_file(path)}")
    except OSError as error:
        return _unreadable(path, error.strerror or str(error))
    except UnicodeDecodeError as error:
        return _unreadable(path, f"not UTF-8 text: byte {error.start} cannot be read")
    return parse_yaml(text, str(path))


def _unreadable(path: Path, message: str) -> YamlDocument:
    return YamlDocument(str(path), None, [Problem(str(path), 0, 0, "", message)])


def parse_yaml(text: str, file: str) -> YamlDocument:
    """Read one YAML document. Never raises for bad text: see `YamlDocument.problems`."""
    document = YamlDocument(file, None)
    try:
        node = _composed(text)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line, column = (mark.line + 1, mark.column + 1) if mark else (1, 1)
        message = " ".join(filter(None, [error.context, error.problem]))
        document.problems.append(Problem(file, line, column, "", f"not YAML: {message}"))
        return document
    except RecursionError:
        document.problems.append(Problem(file, 1, 1, "", "nested too deeply"))
        return document
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        message = f"not YAML: character #x{error.character:04x} is not allowed"
        document.problems.append(Problem(file, line, 1, "", message))
        return document
    if node is None:
        document.problems.append(Problem(file, 1, 1, "", "the file is empty"))
        return document
    document.value = _Reader(document).read(node, (), node.start_mark)
    return document


@lru_cache(maxsize=8)
def _composed(text: str) -> yaml.Node | None:
    """What is read again and again, as a robot's file by all that is done with the robot, is taken
    apart once: that is nearly all of the time which reading it takes. Nobody changes a node."""
    node: yaml.Node | None = yaml.compose(text, Loader=yaml.SafeLoader)
    return node


class _Reader:
    """Walks the node graph once, turning nodes into values and noting where they stand."""

    def __init__(self, document: YamlDocument) -> None:
        self._document = document
        self._constructor = yaml.SafeLoader("")
        self._open: set[int] = set()

    def read(self, node: yaml.Node, location: Location, key_mark: yaml.Mark) -> object:
        self._document.marks[location] = (key_mark, node.start_mark)
        if len(self._document.marks) == _VALUES_AT_MOST:
            self._complain(location, f"more than {_VALUES_AT_MOST} values: is an alias repeated?")
        if len(self._document.marks) >= _VALUES_AT_MOST:
            return None
        if isinstance(node, yaml.ScalarNode):
            return self._scalar(node, location)
        if id(node) in self._open:
            self._complain(location, "refers to itself")
            return None
        if node.tag not in _COLLECTION_TAGS:
            self._complain(location, f"'{node.tag}' is not used here: leave the tag out")
        self._open.add(id(node))
        try:
            if isinstance(node, yaml.SequenceNode):
                return [
                    self.read(item, (*location, index), item.start_mark)
                    for index, item in enumerate(node.value)
                ]
            assert isinstance(node, yaml.MappingNode)
            return self._mapping(node, location)
        finally:
            self._open.discard(id(node))

    def _complain(self, location: Location, message: str, *, at_key: bool = False) -> None:
        self._document.problems.append(self._document.problem(location, message, at_key=at_key))

    def _mapping(self, node: yaml.MappingNode, location: Location) -> dict[str, object]:
        pairs: dict[str, tuple[yaml.Node, yaml.Node]] = {}
        for key_node, value_node in node.value:
            if key_node.tag == _MERGE_TAG:
                continue
            key = self._key(key_node, location)
            if key is None:
                continue
            if key in pairs:
                first = pairs[key][0].start_mark.line + 1
                mark = key_node.start_mark
                path = key_path((*location, key))
                message = f"this key stands twice: it is already on line {first}"
                self._document.problems.append(
                    Problem(self._document.file, mark.line + 1, mark.column + 1, path, message)
                )
                continue
            pairs[key] = (key_node, value_node)
        for key, pair in self._merged(node, location, (node,)):
            pairs.setdefault(key, pair)
        return {
            key: self.read(value_node, (*location, key), key_node.start_mark)
            for key, (key_node, value_node) in pairs.items()
        }

    def _key(self, node: yaml.Node, location: Location) -> str | None:
        if isinstance(node, yaml.ScalarNode):
            return str(node.value)
        mark = node.start_mark
        self._document.problems.append(
            Problem(
                self._document.file,
                mark.line + 1,
                mark.column + 1,
                key_path(location),
                "a key must be a single word",
            )
        )
        return None

    def _merged(
        self, node: yaml.MappingNode, location: Location, chain: tuple[yaml.Node, ...]
    ) -> Iterator[tuple[str, tuple[yaml.Node, yaml.Node]]]:
        """The pairs that `<<:` brings in, nearest first, nested merges included."""
        for key_node, value_node in node.value:
            if key_node.tag != _MERGE_TAG:
                continue
            sources = (
                value_node.value if isinstance(value_node, yaml.SequenceNode) else [value_node]
            )
            for source in sources:
                if not isinstance(source, yaml.MappingNode) or source in chain:
                    self._complain(location, "'<<' takes another mapping, like <<: *name")
                    continue
                for inner_key, inner_value in source.value:
                    if inner_key.tag != _MERGE_TAG and isinstance(inner_key, yaml.ScalarNode):
                        yield str(inner_key.value), (inner_key, inner_value)
                yield from self._merged(source, location, (*chain, source))

    def _scalar(self, node: yaml.ScalarNode, location: Location) -> Hashable:
        if node.tag not in _PLAIN_TAGS:
            self._complain(location, f"'{node.tag}' values are not used here: quote it as text")
            return str(node.value)
        if node.style is None:
            trap = _trap(node)
            if trap:
                self._complain(location, trap)
        try:
            return self._constructor.construct_object(node)  # type: ignore[no-any-return]
        except (ValueError, OverflowError, ConstructorError):
            self._complain(location, f"'{node.value}' cannot be read as a value: quote it as text")
            return str(node.value)


def _number(text: str) -> str:
    """A number in scientific notation the way YAML 1.1 reads it as a number."""
    value = float(text.replace("_", ""))
    return f"{value:.0f}" if value.is_integer() and abs(value) < 1e15 else repr(value)


def _trap(node: yaml.ScalarNode) -> str | None:
    """What YAML 1.1 makes of an unquoted word that most people mean otherwise, or None."""
    text = str(node.value)
    if node.tag == _BOOL_TAG and text.lower() not in ("true", "false"):
        meaning = "true" if text.lower() in ("yes", "on", "y") else "false"
        return f"YAML reads {text} as {meaning}: write {meaning}, or '{text}' for the text"
    if node.tag == _STR_TAG and _NUMBER_READ_AS_TEXT.fullmatch(text):
        if text.startswith("0o"):
            return f"YAML reads {text} as text: write {int(text, 8)}"
        return f"YAML reads {text} as text: write {_number(text)} for the number"
    if node.tag in (_INT_TAG, _FLOAT_TAG) and ":" in text:
        return f"YAML reads {text} as a number to base 60: quote it as text, or write the number"
    digits = text.lstrip("+-")
    if node.tag == _INT_TAG and len(digits) > 1 and digits[0] == "0" and digits[1] in "01234567_":
        return f"YAML reads {text} as octal: write the number without the leading zero"
    return None
