"""Which log is open, and where it goes: a file on board, a stream of blocks to the ground, or both."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from sitl.autopilot.blocks import BlockStream
from sitl.autopilot.logger import OWN, DataFlashLog, Dialect, FileSink, Sink, next_log_path
from sitl.autopilot.modes import LogEvent, Mode, Reason, Severity
from sitl.autopilot.parameters import Parameters

TO_CARD, TO_GROUND = 1, 2
"""Bits of LOG_BACKEND_TYPE."""


class Recording:
    """The logs of one vehicle, one after the other; every log begins with all parameters and the mode."""

    def __init__(
        self,
        directory: Path | None,
        parameters: Parameters,
        *,
        time_us: Callable[[], int],
        armed: Callable[[], bool],
        mode: Callable[[], Mode],
        say: Callable[[Severity, str], None],
        dialect: Dialect = OWN,
        greeting: Sequence[str] = (),
    ) -> None:
        """`directory` takes the files; None keeps none. Every log begins with the `greeting`, too."""
        self.log: DataFlashLog | None = None
        self.stream: BlockStream | None = None
        self.offered = True
        """Whether a START is answered with a stream of the log."""
        self._directory = directory
        self._parameters = parameters
        self._time_us = time_us
        self._armed = armed
        self._mode = mode
        self._say = say
        self._dialect = dialect
        self._greeting = tuple(greeting)

    @property
    def refuses_arming(self) -> bool:
        """Whether a log that is wanted cannot be written, in the eyes of a check before arming."""
        return False

    def write(self, name: str, *values: int | float | bytes) -> None:
        """A message with the time of this sample; nothing while no log is open."""
        if self.log is not None:
            self.log.write(name, self._time_us(), *values)

    def write_parameter(self, name: str) -> None:
        self.write("PARM", name.encode(), self._parameters[name], self._parameters.table[name].default)

    def write_mode(self, reason: Reason) -> None:
        mode = self._mode()
        self.write("MODE", mode, mode, reason)

    def write_event(self, event: LogEvent) -> None:
        self.write("EV", event)

    def start_stream(self) -> BlockStream | None:
        """A new log that also goes out as blocks; a stream under way ends. None where there is none to be had."""
        if not self.offered or not int(self._parameters["LOG_BACKEND_TYPE"]) & TO_GROUND:
            return None
        self._close_log()
        self.stream = BlockStream(int(self._parameters["LOG_MAV_BUFSIZE"]) * 1024, self._time_us() * 1e-6)
        self._open_log(self.stream)
        return self.stream

    def stop_stream(self) -> None:
        """The streamed log ends whole; logging goes on in a new file while armed."""
        if self.stream is None:
            return
        self.stream = None
        self._close_log()
        self.keep_on()

    def drop_stream(self, reason: str | None) -> None:
        """The stream cannot go on; its log does, in the file. None says nothing to anybody."""
        if self.stream is None:
            return
        if self.log is not None:
            self.log.detach(self.stream)
        self.stream.abandon()
        self.stream = None
        if reason is not None:
            self._say(Severity.WARNING, f"Log stream stopped: {reason}")
        self.keep_on()

    def keep_on(self) -> None:
        """Have a log open exactly while one is due."""
        due = self._armed() or self._parameters["LOG_DISARMED"] != 0 or self.stream is not None
        if due and self.log is None:
            self._open_log(None)
        elif not due and self.log is not None:
            self._close_log()

    def flush(self) -> None:
        """Hand over what was written; a disk that does not take it is said."""
        log = self.log
        if log is None:
            return
        log.flush()
        if log.trouble is not None:
            trouble, log.trouble = log.trouble, None
            self._say(Severity.CRITICAL, f"Logging failed: {trouble}")

    def close(self) -> None:
        """End the log whole."""
        self.stream = None
        self._close_log()

    def _open_log(self, stream: BlockStream | None) -> None:
        sinks: list[Sink] = [] if stream is None else [stream]
        card, trouble = self._card()
        sinks += [] if card is None else [card]
        if sinks:
            self.log = DataFlashLog(sinks, self._time_us(), self._dialect)
            self._write_first()
        if trouble is not None:
            self._say(Severity.CRITICAL, f"Logging failed: {trouble}")

    def _card(self) -> tuple[FileSink | None, str | None]:
        """A new file, where one is wanted, or why there is none."""
        if self._directory is None or not int(self._parameters.acting("LOG_BACKEND_TYPE")) & TO_CARD:
            return None, None
        try:
            return FileSink(next_log_path(self._directory)), None
        except OSError as error:
            return None, error.strerror or type(error).__name__

    def _write_first(self) -> None:
        """What a log begins with after its formats."""
        for text in self._greeting:
            self.write("MSG", text.encode("ascii", "replace"))
        for name in self._parameters.table:
            self.write_parameter(name)
        self.write_mode(Reason.START)

    def _close_log(self) -> None:
        if self.log is not None:
            self.log.close()
            self.log = None
