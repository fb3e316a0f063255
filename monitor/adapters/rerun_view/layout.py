"""Layouts sent to Rerun as differences.

The SDK keeps the stream of every blueprint that it ever sent, two threads and some megabytes each, and so does
the viewer's server. A view runs for months: here one stream serves all layouts, and only what has changed since
the last one is logged to it.
"""

from __future__ import annotations

import uuid
from typing import Any

import rerun as rr
import rerun.blueprint as rrb
import rerun_bindings

_NAMES = uuid.UUID("5f1d2c7e-6f0b-4c59-9a39-0c6a1c1f7a11")
"""Namespace of the ids: a view that stays in the layout keeps its id, and so its place and zoom."""


class Sender:
    """Sends the layouts of one recording, one after the other."""

    def __init__(self, recording: rr.RecordingStream) -> None:
        self._recording = recording
        self._stream: Any = None
        self._storage: Any = None
        self._filter: _Changes | None = None

    def send(self, blueprint: rrb.Blueprint) -> None:
        """Make this the layout of the viewer."""
        try:
            self._send_changes(blueprint)
        except (AttributeError, TypeError):  # another SDK: what is used here is not its public face
            self._recording.send_blueprint(blueprint)

    def _send_changes(self, blueprint: rrb.Blueprint) -> None:
        if self._filter is None:
            native = rerun_bindings.new_blueprint(
                application_id="loopsight",
                make_default=False,
                make_thread_default=False,
                default_enabled=True,
            )
            self._stream = rr.RecordingStream._from_native(native)  # noqa: SLF001
            self._storage = self._stream.memory_recording().storage
            self._filter = _Changes(self._stream)
        _name_ids(blueprint.root_container, "root", set())
        self._filter.next()
        blueprint._log_to_stream(self._filter)  # noqa: SLF001
        self._stream.flush(timeout_sec=5.0)
        rerun_bindings.send_blueprint(self._storage, True, True, recording=self._recording.to_native())


class _Changes:
    """Stands for a stream: lets through what differs from what the last layout logged to the same path."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream
        self._before: dict[str, Any] = {}
        self._now: dict[str, Any] = {}
        self._count = 0

    def next(self) -> None:
        """Begin a new layout."""
        self._stream.set_time("blueprint", sequence=self._count)
        self._count += 1
        self._before, self._now = self._now, {}

    def log(self, path: str, entity: Any, *, static: bool = False) -> None:
        """Log, as a stream does, what has changed."""
        batches = entity.as_component_batches()
        facts = [(str(b.component_descriptor()), b.as_arrow_array().to_pylist()) for b in batches]
        key = f"{path} {type(entity).__name__} {static}"
        self._now[key] = facts
        if self._before.get(key) != facts:
            self._stream.log(path, entity, static=static)


def _name_ids(part: Any, name: str, taken: set[uuid.UUID]) -> None:
    """Give every part of the layout an id by its place, origin and name; by number where two are alike."""
    part.id = uuid.uuid5(_NAMES, name)
    while part.id in taken:
        part.id = uuid.uuid5(_NAMES, str(part.id))
    taken.add(part.id)
    for i, child in enumerate(part.contents if isinstance(part, rrb.Container) else ()):
        label = child.name if child.name is not None else i
        _name_ids(child, f"{part.id}/{getattr(child, 'origin', '')}/{label}", taken)
