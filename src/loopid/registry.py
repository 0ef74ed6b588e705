"""Registries: formats, closures, joint terms, estimators and searches, found by their names."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import import_module
from typing import Any, Generic, TypeVar, cast

from loopid.errors import OptionError

Entry = TypeVar("Entry")


class Registry(Mapping[str, Entry], Generic[Entry]):
    """Entries by name, in the order in which they were registered.

    An entry may be given as ``"module:name"``; it is imported when it is first used. In errors it
    is called ``what``.

    Examples
    --------
    >>> from loopid.registry import Registry
    >>> roots = Registry("root")
    >>> roots.register("square", "math:sqrt")
    >>> roots["square"](9.0)
    3.0
    >>> roots["cube"]
    Traceback (most recent call last):
    loopid.errors.OptionError: unknown root 'cube': choose among square
    """

    def __init__(self, what: str, entries: Mapping[str, Entry | str] | None = None) -> None:
        self.what = what
        self._entries: dict[str, Entry | str] = dict(entries or {})

    def register(self, name: str, entry: Entry | str) -> None:
        """Add an entry, or put it in the place of one with the same name."""
        self._entries[name] = entry

    def __getitem__(self, name: str) -> Entry:
        OptionError.require(self.what, name, self)
        entry = self._entries[name]
        if isinstance(entry, str):
            module, _, attribute = entry.partition(":")
            entry = cast(Entry, getattr(import_module(module), attribute))
            self._entries[name] = entry
        return entry

    def get(self, name: str, default: Any = None) -> Any:
        """The entry, or the default where there is none."""
        if name not in self:
            return default
        return self[name]

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and name in self._entries

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)


# Filled by whoever has a format: the core by its own, tools and users by theirs.
log_formats: Registry[Any] = Registry("log format")
# By the ending of the tree's file: a function of it, and of those options of ``Reading`` that it
# takes, that gives a ``TreeSource``.
robot_formats: Registry[Any] = Registry(
    "ending of a robot file", {".urdf": "loopid.loading.urdf:read_urdf"}
)
# By the XPath of what shows that a URDF has it: a function of a ``UrdfFile`` and the model of its
# tree, to mount frames in, that gives a ``Dialect``.
urdf_dialects: Registry[Any] = Registry("sign of a dialect of URDF")
# By the ending of the tree's file: a class of it with the ``inertials`` of its links, ``edited``
# (its content with other ones, and other joint terms) and ``joint_terms`` of such a content.
editable_files: Registry[Any] = Registry("ending of a robot file that can be edited")
# What words of robot files mean, to loading, which is below the laws of joint terms.
words_of_files: Registry[Any] = Registry(
    "word of robot files", {"joint term": "loopid.regressors.joint_laws:joint_term"}
)
# What a fit becomes: functions of its robot or force model, and of its values.
fit_exports: Registry[Any] = Registry(
    "form of a fit",
    {
        "robot file": "loopid.export.robot_file:export_robot_file",
        "C source": "loopid.export.c_code:c_source",
        "Pinocchio": "loopid.export.pinocchio_model:pinocchio_of",
    },
)
