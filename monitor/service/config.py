"""The service's configuration: one frozen record; the command line overrides it, nothing repeats it."""

from __future__ import annotations

import os
import tomllib
from pathlib import Path
from typing import Any

import msgspec

from monitor.adapters.http import split_address

from .journal import FORMATS

VIEWS = ("none", "web", "native")


class ConfigError(ValueError):
    """A configuration that cannot be used; one line for each problem."""


class Config(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings of ``loopsight monitor``; in a TOML file under the same names."""

    loops: str = ""
    """Loop table (.csv, .toml, .parquet); empty: every loop that is heard is registered."""
    id: str = "monitor"
    """Name of this monitor in its own keys."""
    connect: list[str] = []
    """Zenoh endpoints of an existing router."""
    listen: list[str] = []
    """Endpoints to listen on; without both, tcp/127.0.0.1:7447 in router mode."""
    zenoh: str = ""
    """Configuration of Zenoh's own (.json5), for TLS, access control and passwords; empty: none."""
    subscribe: list[str] = msgspec.field(default_factory=lambda: ["plant/**"])
    """Key expressions of samples."""
    state: str = ""
    """Folder for what is kept; empty: $STATE_DIRECTORY, else the user's state folder."""
    auto_register: bool = False
    """Watch loops that are in no table, with default facts."""
    reorder_window: float = 2.0
    """[s] in the samples' time."""
    future: float = 60.0
    """Samples further ahead of the clock than this are refused [s]."""
    view: str = "none"
    """``none``, ``web`` or ``native``."""
    http: str = ""
    """Host and port of /livez, /readyz and /metrics, e.g. 127.0.0.1:9464; empty: none."""
    log: str = "text"
    """Of the lines on stderr: ``text`` for a reader, ``json`` for a machine."""
    commands: bool = False
    """Let whoever may query put a loop's flag aside for a time (``loopsight/@/<id>/command``)."""
    tick: float = 0.05
    """Longest wait between two looks at the inbox [s]."""

    def __post_init__(self) -> None:
        checks = [
            (self.log in FORMATS, "log", self.log, "one of " + ", ".join(FORMATS)),
            (self.view in VIEWS, "view", self.view, "one of " + ", ".join(VIEWS)),
            (
                0 <= self.reorder_window <= 3600,
                "reorder_window",
                self.reorder_window,
                "seconds from 0 to 3600",
            ),
            (0 < self.future <= 1e8, "future", self.future, "seconds above 0, at most 1e8"),
            (0.001 <= self.tick <= 1, "tick", self.tick, "seconds from 0.001 to 1"),
            (bool(self.subscribe), "subscribe", self.subscribe, "at least one key expression"),
            (
                self.id.isprintable() and bool(self.id) and not set(self.id) & set("/*$?#"),
                "id",
                self.id,
                "a name without / * $ ? # and control characters",
            ),
        ]
        if self.http:
            split_address(self.http)
        for ok, name, value, accepted in checks:
            if not ok:
                raise ValueError(f"{name}: {value!r}, expected {accepted}")

    @property
    def state_folder(self) -> Path:
        """Where what is kept lies."""
        if self.state:
            return Path(self.state)
        if os.environ.get("STATE_DIRECTORY"):  # set by systemd
            return Path(os.environ["STATE_DIRECTORY"])
        base = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
        return Path(base) / "loopsight"


def load(path: Path | None, **overrides: Any) -> Config:
    """Read a TOML file (or only the defaults) and override what is not None or empty.

    Raises
    ------
    ConfigError
        One line: file, field, value, what is accepted.
    """
    settings: dict[str, Any] = {}
    if path is not None:
        try:
            settings = tomllib.loads(path.read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
            raise ConfigError(f"{path}: {error}") from None
        for name in ("loops", "zenoh"):  # beside the file that names it
            if settings.get(name) and isinstance(settings[name], str):
                settings[name] = str(path.parent / settings[name])
    settings |= {k: v for k, v in overrides.items() if v is not None and v != ()}
    try:
        return msgspec.convert(settings, Config)
    except (msgspec.ValidationError, ValueError) as error:
        raise ConfigError(f"{path or 'command line'}: {error}") from None


def problems(path: Path) -> list[str]:
    """Return what is wrong with a configuration file; empty where it is fine."""
    try:
        config = load(path)
        if config.zenoh:
            from monitor.adapters.zenoh_bus import read_config  # noqa: PLC0415 (the library takes its time)

            read_config(config.zenoh)
    except OSError as error:
        return str(error).splitlines()
    except ConfigError as error:
        return [str(error)]
    return []
