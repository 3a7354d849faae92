"""HTTP/1.1 whose connections end where the other side keeps them waiting.

uvicorn closes a connection that is idle after an answer. One that never sends its request, sends it
byte by byte, or never reads the answer it would keep until the other side goes away. Here each of
these has a limit, as in mod_reqtimeout of Apache: time, and for a body time by its size.
"""

import asyncio
import socket
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from rona_ui.api.problems import problem

HEAD_S = 10.0  # from the connection, or the first byte after an answer, to the end of the headers
BODY_S = 20.0  # for a body, and a second more for each ...
BYTES_PER_S = 500  # ... of these
UNREAD_S = 60.0  # without a byte taken from an answer that waits to be read
LOOK_S = 1.0  # between two looks at the limits


class TimedProtocol(H11Protocol):
    """A connection that is ended where the other side keeps it waiting.

    What the server itself is slow at (a busy event loop, a body that is not taken yet, a job before
    the answer) does not count.
    """

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait for a request; answers leave at once, see ``_send_at_once``."""
        super().connection_made(transport)
        _send_at_once(transport)
        self._stage: object = None  # what is waited for, and of which request
        self._looked_s = self.loop.time()
        self._waited_s = 0.0
        self._taken = 0  # bytes that have come meanwhile
        self._unread = 0  # bytes of the answer that were not taken at the last look
        self._unread_s = 0.0  # how long they have been as many
        self._timer: asyncio.TimerHandle | None = None
        self._look()

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait no longer."""
        self._end_wait()
        super().connection_lost(exc)

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        """Hand over to the websocket, which has limits of its own."""
        self._end_wait()
        super().handle_websocket_upgrade(event)

    def data_received(self, data: bytes) -> None:
        """Take note that something came."""
        self._taken += len(data)
        super().data_received(data)
        self._follow()

    def on_response_complete(self) -> None:
        """Take note that the next request may come."""
        super().on_response_complete()
        self._follow()

    def _end_wait(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _follow(self) -> None:
        """Begin to count anew where something else is waited for."""
        stage = self.conn.their_state, self.cycle
        if stage != self._stage:
            self._stage, self._waited_s, self._taken = stage, 0.0, 0

    def _look(self) -> None:
        """End the connection if a limit has passed, else look again later."""
        self._follow()
        now_s = self.loop.time()
        passed_s = min(now_s - self._looked_s, 2 * LOOK_S)  # more: the loop itself was busy
        self._looked_s = now_s
        late = self._late(passed_s)
        if late is None and not self._is_unread(passed_s):
            self._timer = self.loop.call_later(LOOK_S, self._look)
        else:
            self._end(late)

    def _late(self, passed_s: float) -> str | None:
        """Return what did not come in time, in words; None where there is time left."""
        their = self.conn.their_state
        self._waited_s += passed_s
        if their is h11.IDLE:
            if self.timeout_keep_alive_task is not None:  # uvicorn counts while nothing comes
                self._waited_s = 0.0
            elif self._waited_s > HEAD_S:
                return f"the headers did not come in time: send them within {HEAD_S:g} s"
        elif their is h11.SEND_BODY:
            if self._holds_body_up():
                self._waited_s, self._taken = 0.0, 0
            elif self._waited_s > BODY_S + self._taken / BYTES_PER_S:
                return (
                    f"the body did not come in time: send it within {BODY_S:g} s "
                    f"and at {BYTES_PER_S} bytes/s or more"
                )
        return None

    def _holds_body_up(self) -> bool:
        """Return whether it is this side that does not take the body at the moment."""
        expected = self.cycle.waiting_for_100_continue and not self.cycle.response_complete
        return expected or self.flow.read_paused

    def _is_unread(self, passed_s: float) -> bool:
        """Return whether no byte of an answer was taken for the time of the limit."""
        size = self.transport.get_write_buffer_size()
        self._unread_s = self._unread_s + passed_s if size and size == self._unread else 0.0
        self._unread = size
        return self._unread_s > UNREAD_S

    def _end(self, late: str | None) -> None:
        """Close at once, and say why where that can be said."""
        self._timer = None
        if late is not None and self._may_answer():
            answer = problem(408, late, headers={"Connection": "close"})
            parts: tuple[Any, ...] = (
                h11.Response(status_code=408, headers=answer.raw_headers, reason=b"Timeout"),
                h11.Data(data=bytes(answer.body)),
                h11.EndOfMessage(),
            )
            for part in parts:
                self.transport.write(self.conn.send(part) or b"")
        if self.conn.their_state is not h11.IDLE and not self.cycle.response_complete:
            self.cycle.disconnected = True  # what the application still sends is dropped
            self.cycle.message_event.set()
        if self.transport.get_write_buffer_size():
            self.transport.abort()  # closing would wait until it is read
        else:
            self.transport.close()

    def _may_answer(self) -> bool:
        """Return whether a request has begun and nothing of an answer was sent."""
        if self.conn.their_state is h11.SEND_BODY:
            return not self.cycle.response_started
        return self.conn.our_state is h11.IDLE and bool(self.conn.trailing_data[0])


def _send_at_once(transport: asyncio.Transport) -> None:
    """Keep no part of an answer back until the part before is acknowledged (Nagle, RFC 896).

    Together with delayed acknowledgements that takes 40 ms an answer on a connection that is kept.
    asyncio turns it off for sockets that name their protocol; those of a server do not.
    """
    open_socket = transport.get_extra_info("socket")
    if open_socket is not None:
        open_socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
