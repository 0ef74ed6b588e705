"""Records in JSON and YAML files."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from io import StringIO
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from loopid.errors import DataError, MissingFileError, OptionError
from loopid.files import why_no_file, write_file

SUFFIXES = (".json", ".yaml", ".yml")


class Saved(ABC):
    """Results that are written as their record."""

    @abstractmethod
    def record(self) -> dict[str, Any]:
        """All of it in plain numbers, lists and texts; None for what is not finite."""

    def save(self, path: str | Path) -> None:
        """Write the record to a .json, .yaml or .yml file, whole or not at all.

        Raises
        ------
        OptionError
            When the name ends otherwise.
        OutputError
            When the file cannot be written.
        """
        write_record(path, self.record())


def write_record(path: str | Path, record: dict[str, Any]) -> None:
    """Write a record of plain numbers, lists and texts, whole or not at all."""
    write_file(path, record_text(path, record))


def record_text(path: str | Path, record: dict[str, Any]) -> str:
    """The content of a file of that name."""
    if _is_json(path):
        return json.dumps(record, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    stream = StringIO()
    _yaml().dump(record, stream)
    return stream.getvalue()


def read_record(path: str | Path) -> dict[str, Any]:
    """Read a record back."""
    is_json = _is_json(path)
    reason = why_no_file(Path(path))
    if reason == "does not exist":
        raise MissingFileError(f"there is no file {path}")
    if reason:
        raise DataError(f"{path} {reason}")
    try:
        text = Path(path).read_text(encoding="utf-8")
        record = json.loads(text) if is_json else _yaml().load(text)
    except (OSError, ValueError, YAMLError) as error:
        reason = str(error).splitlines()[0]
        raise DataError(f"{path} cannot be read: {reason}") from error
    if not isinstance(record, dict):
        raise DataError(f"{path} is not a saved record")
    return record


def _is_json(path: str | Path) -> bool:
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise OptionError.unknown("ending", suffix or str(path), SUFFIXES)
    return suffix == ".json"


def _yaml() -> YAML:
    yaml = YAML(typ="safe", pure=True)
    yaml.allow_unicode = True
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    yaml.default_flow_style = None
    return yaml


def fields_in(
    record: Mapping[str, Any],
    parse: Callable[[Any], dict[str, Any]],
    expected: str,
    refusal: str,
) -> dict[str, Any]:
    """What a record of the expected format holds, as ``parse`` reads it.

    Raises
    ------
    DataError
        The refusal, then what is missing or makes no sense.
    """
    if record.get("format") != expected:
        raise DataError(f"{refusal}: its format is not {expected!r}")
    try:
        return parse(record)
    except KeyError as error:
        raise DataError(f"{refusal}: {error} is missing") from error
    except (TypeError, ValueError, AttributeError, OptionError) as error:
        raise DataError(f"{refusal}: {error}") from error
