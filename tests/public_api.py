"""The public names with their signatures, as text: ``python tests/public_api.py`` writes it."""

import inspect
from dataclasses import is_dataclass
from pathlib import Path

import loopid

FILE = Path(__file__).with_name("public_api.txt")
SUBPACKAGES = sorted(name for name in loopid.__all__ if hasattr(getattr(loopid, name), "__path__"))


def names(package):
    """What a package exports, but subpackages."""
    listed = getattr(package, "__all__", None) or [n for n in dir(package) if not n.startswith("_")]
    return sorted(n for n in listed if not inspect.ismodule(getattr(package, n)))


def described(thing):
    """Parameters with their defaults, in brackets; nothing for what takes none."""
    try:
        parameters = inspect.signature(thing).parameters.values()
    except (TypeError, ValueError):
        return ""
    parts, star = [], False
    for p in parameters:
        if p.kind is p.KEYWORD_ONLY and not star:
            parts.append("*")
            star = True
        star = star or p.kind is p.VAR_POSITIONAL
        parts.append({p.VAR_POSITIONAL: "*", p.VAR_KEYWORD: "**"}.get(p.kind, "") + p.name)
        if p.default is not p.empty:
            default = f"{type(p.default).__name__}()" if is_dataclass(p.default) else p.default
            parts[-1] += f"={default if is_dataclass(p.default) else repr(default)}"
    return f"({', '.join(parts)})"


def text():
    """One line a name; signatures of those that ``loopid`` itself exports."""
    lines = [f"{name}{described(getattr(loopid, name))}" for name in names(loopid)]
    for room in SUBPACKAGES:
        lines += [f"{room}.{name}" for name in names(getattr(loopid, room))]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    FILE.write_text(text())
