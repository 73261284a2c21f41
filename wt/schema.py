"""From YAML files and overrides to checked dataclasses; every mistake becomes one line.

``wt.config`` says what a configuration holds, and each world says it for its own options; here
stands how either is read. OmegaConf converts and checks the values; keys, sections and lists are
checked before, since its messages about those name no key.
"""

from __future__ import annotations

import dataclasses
import json
import typing
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import omegaconf
import yaml
from omegaconf import OmegaConf

from wt.errors import ConfigError, suggest
from wt.shipped import configuration, folder

T = TypeVar("T")


def read(path: Path, overrides: Sequence[str] = ()) -> dict[str, Any]:
    """A YAML file on top of the one it names under ``base:``, with overrides on top of both.

    Args:
        path: the file, or the bare name of one that comes with the package.
        overrides: ``key=value`` words; lists and dotted keys are allowed.

    Raises:
        ConfigError: file missing, not YAML, its own base, or an override of another form.
    """
    return override(_read(configuration(path), ()), overrides)


def varied(config: object, overrides: Sequence[str]) -> dict[str, Any]:
    """A dataclass as nested plain values, with overrides on top.

    Raises:
        ConfigError: an override of another form.
    """
    plain = OmegaConf.to_container(OmegaConf.structured(config))
    return override(typing.cast(dict[str, Any], plain), overrides)


def override(tree: dict[str, Any], overrides: Sequence[str]) -> dict[str, Any]:
    """Nested plain values with ``key=value`` words put on top, in place.

    Raises:
        ConfigError: a word is of another form.
    """
    for word in overrides:
        if "=" not in word:
            raise ConfigError(f"override {word!r} is not of the form key=value")
        try:
            new = OmegaConf.to_container(OmegaConf.from_dotlist([word]))
        except (yaml.YAMLError, omegaconf.errors.OmegaConfBaseException) as error:
            raise ConfigError(
                f"override {word!r}: its value is not YAML ({' '.join(str(error).split())}); "
                "put quotes around text with brackets or braces"
            ) from error
        _merge(tree, typing.cast(dict[str, Any], new))
    return tree


def merge(tree: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    """Nested plain values with others on top; neither is changed."""
    out: dict[str, Any] = {}
    _merge(out, tree)
    _merge(out, new)
    return out


def parse(schema: type[T], values: Mapping[str, Any], where: str) -> T:
    """Build a dataclass from nested plain values, checking every key and type.

    Args:
        schema: a dataclass type.
        values: what the file says.
        where: dotted prefix for messages, e.g. ``"world."``.

    Raises:
        ConfigError: an unknown key (names the nearest), a wrong type, or a missing value.
    """
    _check_keys(schema, values, where)
    try:
        merged = OmegaConf.merge(OmegaConf.structured(schema), OmegaConf.create(dict(values)))
        return OmegaConf.to_object(merged)  # type: ignore[return-value]
    except omegaconf.errors.MissingMandatoryValue as error:
        raise ConfigError(f"{where}{error.full_key} is missing; add it to the YAML") from error
    except omegaconf.errors.OmegaConfBaseException as error:
        what = str(error.msg or error).splitlines()[0].rstrip(".")
        raise ConfigError(f"{where}{error.full_key or ''}: {what}") from error


def to_yaml(config: object) -> str:
    """A configuration as YAML that :func:`read` and :func:`parse` bring back unchanged."""
    return OmegaConf.to_yaml(OmegaConf.structured(config))


def flat(config: object) -> dict[str, object]:
    """A configuration as dotted keys, lists as JSON: MLflow's parameters."""
    entries: dict[str, object] = {}

    def walk(prefix: str, value: object) -> None:
        if isinstance(value, Mapping):
            for key, inner in value.items():
                walk(f"{prefix}.{key}" if prefix else str(key), inner)
        else:
            entries[prefix] = json.dumps(value) if isinstance(value, list) else value

    walk("", OmegaConf.to_container(OmegaConf.create(to_yaml(config))))
    return entries


def check_numbers(section: object, above_zero: Collection[str], where: str = "") -> None:
    """Refuse numbers of a dataclass, and of those inside it, that no key can have.

    Args:
        section: the dataclass.
        above_zero: keys of any section that zero makes meaningless; no other may be negative.
        where: dotted prefix for messages.

    Raises:
        ConfigError: a number is too small, or none at all.
    """
    for key, value in vars(section).items():
        if dataclasses.is_dataclass(value):
            check_numbers(value, above_zero, f"{where}{key}.")
        elif isinstance(value, int | float) and not isinstance(value, bool):
            above = key in above_zero
            if not (value > 0 if above else value >= 0):  # so that NaN is refused too
                needed = "above zero" if above else "zero or more"
                raise ConfigError(f"{where}{key} is {value}; it must be {needed}")


def _read(path: Path, above: tuple[Path, ...]) -> dict[str, Any]:
    if not path.is_file():
        near = {p.name for p in path.parent.glob("*.yaml")} if path.parent.is_dir() else set()
        if len(path.parts) == 1:
            near |= {p.stem for p in folder("conf").glob("*.yaml")}
        hint = suggest(path.name, near) if near else "no YAML file is near it"
        raise ConfigError(f"configuration {str(path)!r} does not exist; {hint}")
    if path.resolve() in above:
        raise ConfigError(f"{path} is its own base; remove the key 'base' from one of the files")
    try:
        own = yaml.safe_load(path.read_text()) or {}
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path} is not YAML: {' '.join(str(error).split())}") from error
    if not isinstance(own, dict):
        raise ConfigError(f"{path} holds a {type(own).__name__}; keys with values are needed")
    base = own.pop("base", None)
    tree = {} if base is None else _read(path.parent / str(base), (*above, path.resolve()))
    _merge(tree, own)
    return tree


def _merge(into: dict[str, Any], new: Mapping[str, Any]) -> None:
    for key, value in new.items():
        if isinstance(value, Mapping):
            # a dictionary of its own even for a new key: two keys may share one by a YAML anchor
            if not isinstance(into.get(key), dict):
                into[key] = {}
            _merge(into[key], value)
        else:
            into[key] = value


def _check_keys(schema: type, values: Mapping[str, Any], where: str) -> None:
    hints = typing.get_type_hints(schema)
    allowed = [f.name for f in dataclasses.fields(schema)]
    for key, value in values.items():
        if key not in allowed:
            raise ConfigError(f"unknown key '{where}{key}'; {suggest(str(key), allowed)}")
        kinds = typing.get_args(hints[key]) or (hints[key],)  # X | None has two
        section = next((k for k in kinds if dataclasses.is_dataclass(k)), None)
        origin = typing.get_origin(hints[key])
        if value is None and type(None) in kinds:
            continue
        if section is not None and isinstance(value, Mapping):
            _check_keys(typing.cast(type, section), value, f"{where}{key}.")
        elif section is not None:
            names = ", ".join(f.name for f in dataclasses.fields(section))
            raise ConfigError(f"{where}{key} is {value!r}; it needs keys with values: {names}")
        elif value is None:
            raise ConfigError(f"{where}{key} is null; it needs a value")
        elif isinstance(value, Mapping) != (origin is dict):
            needs = "keys with values" if origin is dict else "one value, without keys below it"
            raise ConfigError(f"{where}{key} is {value!r}; it needs {needs}")
        elif origin in (list, tuple):
            _check_list(f"{where}{key}", value, kinds[0])


def _check_list(key: str, value: object, kind: Any) -> None:  # noqa: ANN401 – of a type hint
    if not isinstance(value, list | tuple):
        raise ConfigError(f"{key} is {value!r}; it needs a list, as in {key}=[{value}]")
    for item in value if isinstance(kind, type) else ():  # a Literal is OmegaConf's to check
        try:
            kind(item)
        except (TypeError, ValueError) as error:
            raise ConfigError(
                f"{key} holds {item!r}; it needs a list of {kind.__name__}"
            ) from error
