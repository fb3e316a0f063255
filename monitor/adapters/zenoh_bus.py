"""Zenoh: the only file that opens sessions. Everything it opens listens on loopback unless told otherwise."""

from __future__ import annotations

import json
import os
import re
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any

import zenoh

from monitor.contract import keys
from monitor.contract.entries import MOST_PAYLOAD_BYTES, Message
from monitor.contract.times import ns_of

from .inbox import Inbox

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
CONNECT_WITHIN_MS = 3000
"""How long a session that is opened waits for the other side."""
RECONNECT = {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 1.5}
"""A router that comes back is found within a second; set as one object, single fields are refused."""
OURS = ("mode", "connect/endpoints", "listen/endpoints")
"""What a file of Zenoh's own may not set: it is said in one place, with all else of the monitor's."""
_DEFAULTS = {path: zenoh.Config().get_json(path) for path in OURS}
FILES = (
    *(
        f"transport/link/tls/{n}"
        for n in (
            "root_ca_certificate", "listen_certificate", "listen_private_key", "connect_certificate",
            "connect_private_key",
        )
    ),
    "transport/auth/usrpwd/dictionary_file",
)  # fmt: skip
"""Files that such a file names."""
MOST_TWINS = 100
"""Other monitors of our name that are counted."""
ANSWER_BYTES = 64 * 2**20
"""Bytes of all replies to a question after which no more are taken: whoever answers may be anybody."""
QUESTION_BYTES = 64 * 1024
"""Bytes of a query's payload above which it is left unread."""


class BusError(OSError):
    """A session that could not be opened."""


class NobodyThereError(BusError):
    """Nobody answers at any endpoint to connect to: they may come yet."""


def open_session(
    mode: str = "client",
    connect: Sequence[str] = (),
    listen: Sequence[str] = (),
    options: Mapping[str, Any] | None = None,
    file: str = "",
) -> Any:
    """Open a Zenoh session without scouting.

    Parameters
    ----------
    mode
        ``router`` (others meet through this process), ``client``, ``peer``.
    connect, listen
        Endpoints, e.g. ``tcp/127.0.0.1:7447``.
    options
        Further settings of Zenoh's configuration, by path.
    file
        A configuration of Zenoh's own (TLS, access control, passwords); empty: none.

    Raises
    ------
    BusError
        One line: the endpoint, or the file, and what was wrong; `NobodyThereError` where another try may do.
    """
    config = read_config(file) if file else zenoh.Config()
    settings: dict[str, Any] = {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "listen/endpoints": list(listen),
        "connect/endpoints": list(connect),
        "connect/retry": RECONNECT,
        "connect/timeout_ms": CONNECT_WITHIN_MS,
        "timestamping/enabled": True,
        "transport/link/rx/max_message_size": 4 * MOST_PAYLOAD_BYTES,  # Zenoh's own limit is a gigabyte
        **(options or {}),
    }
    try:
        for path, value in settings.items():
            config.insert_json5(path, json.dumps(value))
        return zenoh.open(config)
    except zenoh.ZError as error:
        where = ", ".join([*connect, *listen])
        kind = NobodyThereError if "Unable to connect" in str(error) else BusError
        raise kind(f"{where}: cannot open a Zenoh session: {_why(error)}") from None


def read_config(file: str) -> zenoh.Config:
    """Read a configuration of Zenoh's own.

    Raises
    ------
    BusError
        One line for each problem: it cannot be read, it sets what is not its business, a file that it names is missing.
    """
    try:
        config = zenoh.Config.from_file(file)
    except zenoh.ZError as error:
        raise BusError(f"{file}: {_why(error)}") from None
    wrong = [
        f"{file}: {path}: expected in the monitor's configuration, or on the command line"
        for path in OURS
        if config.get_json(path) != _DEFAULTS[path]
    ]
    for path in FILES:
        name = json.loads(config.get_json(path))
        if name is not None and not os.access(name, os.R_OK):
            wrong.append(f"{file}: {path}: {name}: no such file, or it may not be read")
    if wrong:
        raise BusError("\n".join(wrong))
    return config


def _why(error: zenoh.ZError) -> str:
    """Say in a line what Zenoh complains of, without the library's own source lines."""
    text = str(error)
    message = re.search(r'msg: "(.*?)", location: Some\(Location { line: (\d+)', text)
    place = re.search(r" --> (\d+):", text)
    if message:
        return f"line {message[2]}: {message[1].split(' at /')[0]}"
    if place:  # drawn over several lines
        return f"line {place[1]}: {text.rpartition('= ')[2].split(' at /')[0]}"
    return re.split(r" at /| \[", text.splitlines()[0])[0].removesuffix(" to any of")


class Question:
    """A query that waits for its answers."""

    def __init__(self, query: zenoh.Query) -> None:
        self._query = query
        self.key = str(query.key_expr)
        self.parameters = _parameters(str(query.parameters))
        payload = query.payload
        self.payload = b"" if payload is None or len(payload) > QUESTION_BYTES else payload.to_bytes()

    def matches(self, key: str) -> bool:
        """Whether this key is asked for."""
        return bool(self._query.key_expr.intersects(zenoh.KeyExpr(key)))

    def reply(self, key: str, payload: bytes, encoding: str) -> None:
        """Send one of its replies; a querier that has gone is no error."""
        with suppress(zenoh.ZError):
            self._query.reply(key, payload, encoding=encoding)

    def end(self) -> None:
        """Say that there are no more."""
        self._query.drop()  # type: ignore[no-untyped-call]  # so it stands in the library's stub

    def refuse(self, why: str) -> None:
        """Answer with an error, and end the query."""
        with suppress(zenoh.ZError):
            self._query.reply_err(why)
        self.end()


def _parameters(text: str) -> dict[str, str]:
    """Read ``name=value&name=value``, as the contract and URLs have it, or with Zenoh's own ``;``."""
    parts = (part.partition("=") for part in re.split("[;&]", text) if part)
    return {name: value for name, _, value in parts}


class Bus:
    """A monitor's session: hears into an inbox, is asked into a list, speaks under one prefix.

    Parameters
    ----------
    session
        An open session; closed with `close` (a session with a callback that is not closed hangs at exit).
    prefix
        The only key space that is ever written to.
    """

    def __init__(self, session: Any, prefix: str = keys.PREFIX) -> None:
        self._session = session
        self._prefix = prefix
        self._declared: list[Any] = []
        self._subscribed: list[Any] = []
        self.inbox: Inbox[Message] = Inbox()
        self.questions: deque[Question] = deque(maxlen=1000)
        self.publish_failed = 0
        """What Zenoh would not take."""
        self.twins = 0
        """Other monitors that call themselves as we do."""

    def subscribe(self, keys: Sequence[str], arrival: Callable[[], int]) -> None:
        """Listen to key expressions; messages without a timestamp take ``arrival()`` [ns].

        What a monitor says is left out: it would hear itself.

        Raises
        ------
        BusError
            One is no key expression.
        """
        inbox, ours = self.inbox, self._prefix + "/"

        def enqueue(sample: zenoh.Sample) -> None:
            key = str(sample.key_expr)
            if key.startswith(ours):
                return
            stamp = sample.timestamp
            time = arrival() if stamp is None else ns_of(stamp.get_time().astimezone())
            inbox.put(Message(key, sample.payload.to_bytes(), time))

        for key in keys:
            try:
                self._subscribed.append(self._session.declare_subscriber(key, enqueue))
            except zenoh.ZError:
                raise BusError(f"subscribe: {key!r}, expected a key expression, e.g. plant/**") from None

    def hears(self, key: str) -> bool:
        """Whether a subscription hears a key, or one beneath it."""
        own = [zenoh.KeyExpr(key), zenoh.KeyExpr(f"{key}/**")]
        return any(s.key_expr.intersects(one) for s in self._subscribed for one in own)

    def answer(self, keys: Sequence[str]) -> None:
        """Accept queries on these key expressions; they wait in ``questions`` for our own thread."""
        for key in keys:
            self._declared.append(
                self._session.declare_queryable(key, lambda query: self.questions.append(Question(query)))
            )

    def alive(self, key: str) -> None:
        """Declare a liveliness token; it goes with the session."""
        self._declared.append(self._session.liveliness().declare_token(key))

    def look_for_twins(self, monitor: str, found: Callable[[int], None]) -> None:
        """Let others who call themselves as we do know of us, and look for them.

        Parameters
        ----------
        found
            Called with how many there are whenever there is one more, on a thread of the bus.
        """
        own = keys.monitor_instance(monitor, str(self._session.zid()))
        tokens: set[str] = set()

        def hear(sample: zenoh.Sample) -> None:
            key, before = str(sample.key_expr), len(tokens)
            if sample.kind == zenoh.SampleKind.DELETE:
                tokens.discard(key)
            elif key != own and before < MOST_TWINS:
                tokens.add(key)
            self.twins = len(tokens)
            if self.twins > before:
                found(self.twins)

        liveliness, every = self._session.liveliness(), keys.monitor_instance(monitor, "*")
        self._declared.append(liveliness.declare_subscriber(every, hear, history=True))
        self._declared.append(liveliness.declare_token(own))

    def publish(self, key: str, payload: bytes, encoding: str) -> None:
        """Publish under the prefix; a subscriber that does not take it loses it, we never wait.

        Raises
        ------
        ValueError
            The key lies outside the prefix: nothing is ever written to a plant.
        """
        if not key.startswith(self._prefix + "/"):
            raise ValueError(f"{key}: outside {self._prefix}/, the monitor only ever writes there")
        try:
            self._session.put(
                key, payload, encoding=encoding, congestion_control=zenoh.CongestionControl.DROP
            )
        except zenoh.ZError:
            self.publish_failed += 1

    def close(self) -> None:
        """Undeclare everything and close the session, whatever state it is in."""
        for declared in [*self._subscribed, *self._declared]:
            with suppress(zenoh.ZError):
                declared.undeclare()
        self._subscribed.clear()
        self._declared.clear()
        with suppress(zenoh.ZError):
            self._session.close()


def ask(session: Any, key: str, seconds: float) -> list[tuple[str, bytes]]:
    """Return the replies (key, payload) to a query; a refusal or a time-out is no reply."""
    answers = (reply.ok for reply in session.get(key, timeout=seconds))
    size = 0
    return [
        (str(a.key_expr), a.payload.to_bytes())
        for a in answers
        if a is not None and (size := size + len(a.payload)) <= ANSWER_BYTES
    ]


def plant_put(session: Any) -> Callable[[str, bytes], None]:
    """Return ``put(key, payload)`` for a simulated plant: blocking, so that no sample of a burst is lost."""

    def put(key: str, payload: bytes) -> None:
        session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK)

    return put
