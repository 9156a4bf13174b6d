"""MAVLink 2 on one link: telemetry, commands, parameters, the log's blocks and its files, for up to eight peers.

The server is polled between samples in the vehicle's own thread (see `sitl.protocol.links` for why) and never waits.
Times are the vehicle's own seconds. Frames of both MAVLink versions are read, since pymavlink speaks version 1 until it
has heard version 2; the vehicle itself speaks version 2. On UDP a peer exists from its first frame with a valid
checksum on, so stray datagrams cost nothing.

Nobody arms, takes off or lands over the link: those commands are denied, the pilot does that.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.blocks import BlockStream
from sitl.autopilot.modes import Reason
from sitl.autopilot.parameters import Answer
from sitl.autopilot.vehicle import Vehicle
from sitl.protocol.ftp import FtpServer
from sitl.protocol.links import Address, Link
from sitl.protocol.log_download import LogDownload
from sitl.protocol.signatures import Signatures
from sitl.protocol.telemetry import DEFAULT_INTERVALS_S, MESSAGES, Message

SYSTEM = 1
AUTOPILOT = mavlink.MAV_COMP_ID_AUTOPILOT1
LOGGER = mavlink.MAV_COMP_ID_LOG

_START = mavlink.MAV_REMOTE_LOG_DATA_BLOCK_START
_STOP = mavlink.MAV_REMOTE_LOG_DATA_BLOCK_STOP
_SAME_START_S = 1.0  # a START repeated this soon is the same one, sent again on a lossy link

_PEERS = 8
_FORGET_S = 30.0
_PARAMETERS_A_TURN = 5
_TEXT_BYTES = 50
_LONGEST_INTERVAL_MS = 60_000


class _Outlet:
    """What pymavlink writes its packed messages to."""

    def __init__(self, link: Link, address: Address) -> None:
        self._link = link
        self._address = address

    def write(self, data: bytes) -> None:
        self._link.send(self._address, bytes(data))


class _Peer:
    """One ground station: its own sequence numbers, intervals and half-received frames."""

    def __init__(
        self, link: Link, address: Address, now_s: float, shortest_ms: float, signatures: Signatures | None
    ) -> None:
        """`shortest_ms` is the least interval of a message, in milliseconds."""
        self._shortest_ms = shortest_ms
        outlet = _Outlet(link, address)
        self.address = address
        self.autopilot = mavlink.MAVLink(outlet, SYSTEM, AUTOPILOT)
        self.logger = mavlink.MAVLink(outlet, SYSTEM, LOGGER)
        if signatures is not None:
            signatures.equip(self.autopilot)
            signatures.equip(self.logger)
        self.heard_s = now_s
        self.received = bytearray()
        self.parameters: deque[int] = deque()
        """Indices of the list still to be sent."""
        self.names: tuple[str, ...] = ()
        self.period_s = dict(DEFAULT_INTERVALS_S)
        self.due_s = dict.fromkeys(self.period_s, now_s)

    def send(self, message: Message) -> None:
        self.autopilot.send(message)

    def telemetry(self, vehicle: Vehicle, now_s: float) -> None:
        for number, due_s in self.due_s.items():
            if now_s >= due_s:
                period_s = self.period_s[number]
                # Keeps the rhythm; after a pause it starts anew instead of catching up.
                self.due_s[number] = max(due_s + period_s, now_s + 0.5 * period_s)
                self.send(MESSAGES[number](vehicle))

    def set_interval(self, number: int, interval_us: float, now_s: float) -> bool:
        """As ArduPilot: -1 stops, 0 is the default, else whole milliseconds and at most 0.8 of the loop rate.

        The heartbeat stays as it is: without it a ground station takes the vehicle for lost.
        """
        if number not in MESSAGES or number == mavlink.MAVLINK_MSG_ID_HEARTBEAT or not math.isfinite(interval_us):
            return False
        if interval_us < 0:
            self.period_s.pop(number, None)
            self.due_s.pop(number, None)
            return True
        if interval_us == 0:
            period_s = DEFAULT_INTERVALS_S.get(number)
            if period_s is None:
                return self.set_interval(number, -1, now_s)
        else:
            interval_ms = min(_LONGEST_INTERVAL_MS, max(1, int(interval_us / 1000)))
            if interval_ms < self._shortest_ms:
                return False
            period_s = interval_ms * 1e-3
        self.period_s[number] = period_s
        self.due_s[number] = now_s
        return True


class _Delivery:
    """A block stream and who it goes to."""

    def __init__(self, stream: BlockStream, peer: _Peer, system: int, component: int, now_s: float) -> None:
        self.stream = stream
        self.peer = peer
        self.system = system
        self.component = component
        self.start_s = now_s


class Server:
    """The vehicle's end of one link."""

    def __init__(
        self,
        vehicle: Vehicle,
        link: Link,
        troubles: Sequence[Callable[[Vehicle], None]] = (),
        signatures: Signatures | None = None,
    ) -> None:
        """`troubles` are called with the vehicle at every poll: what goes wrong on board, see `sitl.faults`."""
        self.vehicle = vehicle
        self.link = link
        self.signatures = signatures
        self._troubles = tuple(troubles)
        self._peers = {address: self._made(address) for address in link.known}
        self._polled_s = vehicle.time_s
        self._delivery: _Delivery | None = None
        self._downloads = (LogDownload(vehicle), FtpServer(vehicle))
        logs, files = self._downloads
        self._text_id = 0
        self._told = (vehicle.mode, vehicle.armed)
        """What the last heartbeat said."""
        self._parser = mavlink.MAVLink(None)
        self._answers: dict[int, Callable[[_Peer, Message], None]] = {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: self._hear_heartbeat,
            mavlink.MAVLINK_MSG_ID_COMMAND_LONG: self._obey,
            mavlink.MAVLINK_MSG_ID_COMMAND_INT: self._obey,
            mavlink.MAVLINK_MSG_ID_SET_MODE: self._set_mode_old,
            mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_LIST: self._list_parameters,
            mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ: self._read_parameter,
            mavlink.MAVLINK_MSG_ID_PARAM_SET: self._write_parameter,
            mavlink.MAVLINK_MSG_ID_TIMESYNC: self._synchronise,
            mavlink.MAVLINK_MSG_ID_REMOTE_LOG_BLOCK_STATUS: self._take_receipt,
            mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_LIST: self._list_mission,
            mavlink.MAVLINK_MSG_ID_LOG_REQUEST_LIST: logs.hear,
            mavlink.MAVLINK_MSG_ID_LOG_REQUEST_DATA: logs.hear,
            mavlink.MAVLINK_MSG_ID_LOG_REQUEST_END: logs.hear,
            mavlink.MAVLINK_MSG_ID_LOG_ERASE: logs.hear,
            mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL: files.hear,
        }

    def poll(self) -> None:
        """Take in what came, send what is due. Never waits."""
        now_s = self.vehicle.time_s
        if now_s < self._polled_s:
            self._start_again()
        self._polled_s = now_s
        if self.signatures is not None:
            self.signatures.advance()
        for trouble in self._troubles:
            trouble(self.vehicle)
        for address, data in self.link.receive():
            self._take(address, data, now_s)
        for address in self.link.gone():
            self._forget(address)
        self._send_texts()
        told, self._told = self._told, (self.vehicle.mode, self.vehicle.armed)
        for peer in list(self._peers.values()):
            if told != self._told:  # as ArduPilot: a change of mode is told at once
                peer.due_s[mavlink.MAVLINK_MSG_ID_HEARTBEAT] = now_s
            if now_s - peer.heard_s > _FORGET_S and peer.address not in self.link.known:
                self._forget(peer.address)
                continue
            peer.telemetry(self.vehicle, now_s)
            self._send_parameters(peer)
        self._send_blocks(now_s)
        for download in self._downloads:
            to = download.address
            download.poll(now_s, to is not None and self.link.room(to))

    def _forget(self, address: Address) -> None:
        self._peers.pop(address, None)
        for download in self._downloads:
            download.forget(address)

    def _made(self, address: Address) -> _Peer:
        vehicle = self.vehicle
        shortest_ms = vehicle.clothes.shortest_interval(1000 * vehicle.dt / 0.8)
        return _Peer(self.link, address, vehicle.time_s, shortest_ms, self.signatures)

    def _start_again(self) -> None:
        """The vehicle has booted: nothing is left of what it knew of its links but that they are there."""
        self._delivery = None
        for address in self._peers:
            for download in self._downloads:
                download.forget(address)
        self._peers = {address: self._made(address) for address in self._peers}

    def close(self) -> None:
        """End the log whole, send what is left of a stream once, and hang up."""
        self.vehicle.close()
        delivery = self._delivery
        if delivery is not None:
            while blocks := delivery.stream.due(self.vehicle.time_s):
                self._send_each(delivery, blocks)
        self.link.close()

    # In

    def _take(self, address: Address, data: bytes, now_s: float) -> None:
        peer = self._peers.get(address)
        stream = isinstance(address, (int, str))  # datagrams hold whole frames, streams do not
        buffer = peer.received if peer is not None and stream else bytearray()
        buffer += data
        for message in self._frames(buffer):
            if peer is None:
                peer = self._new_peer(address, now_s)
            peer.heard_s = now_s
            answer = self._answers.get(message.get_msgId())
            if answer is not None and self._is_addressed(message):
                answer(peer, message)
        if peer is None and stream:  # connected, and listening before it says anything
            self._new_peer(address, now_s).received = buffer

    def _new_peer(self, address: Address, now_s: float) -> _Peer:
        if len(self._peers) >= _PEERS:
            strangers = [peer for peer in self._peers.values() if peer.address not in self.link.known]
            if strangers:
                del self._peers[min(strangers, key=lambda peer: peer.heard_s).address]
        peer = self._peers[address] = self._made(address)
        return peer

    def _frames(self, buffer: bytearray) -> list[Message]:
        """Whole frames with a valid checksum, taken off the buffer; an incomplete one stays."""
        messages: list[Message] = []
        while True:
            starts = [i for i in (buffer.find(0xFD), buffer.find(0xFE)) if i >= 0]
            if not starts:
                buffer.clear()
                return messages
            del buffer[: min(starts)]
            if len(buffer) < 3:
                return messages
            if buffer[0] == 0xFD:
                size = buffer[1] + 12 + (13 if buffer[2] & mavlink.MAVLINK_IFLAG_SIGNED else 0)
            else:
                size = buffer[1] + 8
            if len(buffer) < size:
                return messages
            try:
                message = self._parser.decode(bytearray(buffer[:size]))
            except mavlink.MAVError:
                del buffer[:1]  # no frame after all: the next marker may be a real one
                continue
            del buffer[:size]
            known = not isinstance(message, mavlink.MAVLink_unknown)
            if known and (self.signatures is None or self.signatures.accept(message)):
                messages.append(message)

    @staticmethod
    def _is_addressed(message: Message) -> bool:
        system = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        return system in (0, SYSTEM) and component in (0, AUTOPILOT, LOGGER)

    def _hear_heartbeat(self, peer: _Peer, message: Message) -> None:
        self.vehicle.ground.hear(message.get_srcSystem())
        if self.vehicle.clothes.forwards:
            for other in self._peers.values():
                if other is not peer:
                    self.link.send(other.address, bytes(message.get_msgbuf()))

    def _synchronise(self, peer: _Peer, message: Message) -> None:
        if message.tc1 == 0:
            peer.send(mavlink.MAVLink_timesync_message(self.vehicle.time_us * 1000, message.ts1))

    def _list_mission(self, peer: _Peer, message: Message) -> None:
        peer.send(mavlink.MAVLink_mission_count_message(message.get_srcSystem(), message.get_srcComponent(), 0))

    # Commands

    def _obey(self, peer: _Peer, message: Message) -> None:
        arguments = (message.param1, message.param2)
        result = self._result(peer, message.command, *(x if math.isfinite(x) else None for x in arguments))
        peer.send(
            mavlink.MAVLink_command_ack_message(
                message.command, result, 0, 0, message.get_srcSystem(), message.get_srcComponent()
            )
        )

    def _result(self, peer: _Peer, command: int, first: float | None, second: float | None) -> int:
        denied: int = mavlink.MAV_RESULT_DENIED
        accepted: int = mavlink.MAV_RESULT_ACCEPTED
        failed: int = mavlink.MAV_RESULT_FAILED
        unsupported: int = mavlink.MAV_RESULT_UNSUPPORTED
        if command == mavlink.MAV_CMD_DO_SET_MODE:
            if first is None or second is None or not int(first) & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
                return denied
            return accepted if self.vehicle.set_mode(int(second), Reason.GROUND) else failed
        if command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            if first is None or second is None:
                return denied
            return accepted if peer.set_interval(int(first), second, self.vehicle.time_s) else failed
        if command == mavlink.MAV_CMD_REQUEST_MESSAGE:
            build = MESSAGES.get(int(first)) if first is not None else None
            if build is None:
                return unsupported
            peer.send(build(self.vehicle))
            return accepted
        if command == mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES:
            peer.send(MESSAGES[mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION](self.vehicle))
            return accepted
        if command == mavlink.MAV_CMD_GET_MESSAGE_INTERVAL:
            if first is None or int(first) not in MESSAGES:
                return unsupported
            period_s = peer.period_s.get(int(first))
            interval_us = -1 if period_s is None else round(period_s * 1e6)
            peer.send(mavlink.MAVLink_message_interval_message(int(first), interval_us))
            return accepted
        if command in (
            mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
            mavlink.MAV_CMD_NAV_TAKEOFF,
            mavlink.MAV_CMD_NAV_LAND,
        ):
            return denied
        return unsupported

    def _set_mode_old(self, peer: _Peer, message: Message) -> None:
        """The message that DO_SET_MODE replaced; some ground stations still send it."""
        if message.base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            self.vehicle.set_mode(message.custom_mode, Reason.GROUND)

    # Parameters

    def _list_parameters(self, peer: _Peer, message: Message) -> None:
        peer.names = self.vehicle.parameters.visible()
        peer.parameters = deque(range(len(peer.names)))

    def _send_parameters(self, peer: _Peer) -> None:
        for _ in range(min(_PARAMETERS_A_TURN, len(peer.parameters))):
            if not self.link.room(peer.address):
                return
            index = peer.parameters.popleft()
            answer = self.vehicle.parameters.read(peer.names[index])
            if answer is not None:
                peer.send(self._parameter_value(answer, index, len(peer.names)))

    def _read_parameter(self, peer: _Peer, message: Message) -> None:
        names = self.vehicle.parameters.visible()
        index = message.param_index
        if index >= 0:
            name = names[index] if index < len(names) else ""
        else:
            name = message.param_id
        answer = self.vehicle.parameters.read(name)
        if answer is not None:
            peer.send(self._parameter_value(answer, index if index >= 0 else 0xFFFF, len(names)))

    def _write_parameter(self, peer: _Peer, message: Message) -> None:
        answer = self.vehicle.write_parameter(message.param_id, message.param_value)
        if answer is None:
            return
        # Told to everyone: another station's list must not go stale.
        count = self.vehicle.parameters.count
        for other in self._peers.values():
            other.send(self._parameter_value(answer, 0xFFFF, count))

    @staticmethod
    def _parameter_value(answer: Answer, index: int, count: int) -> Message:
        return mavlink.MAVLink_param_value_message(answer.name.encode(), answer.value, int(answer.kind), count, index)

    # Texts

    def _send_texts(self) -> None:
        texts = self.vehicle.texts
        while texts:
            severity, text = texts.popleft()
            for message in self._chunks(int(severity), text.encode("ascii", "replace")):
                for peer in self._peers.values():
                    peer.send(message)

    def _chunks(self, severity: int, text: bytes) -> list[Message]:
        """One message, or several with an id where the text is too long for one."""
        if len(text) <= _TEXT_BYTES:
            return [mavlink.MAVLink_statustext_message(severity, text)]
        self._text_id = self._text_id % 0xFFFF + 1
        # A text ends with the first chunk that is not full, so one of a full length needs an empty one more.
        starts = range(0, len(text) + 1, _TEXT_BYTES)
        return [
            mavlink.MAVLink_statustext_message(severity, text[start : start + _TEXT_BYTES], self._text_id, number)
            for number, start in enumerate(starts)
        ]

    # Log blocks

    def _take_receipt(self, peer: _Peer, message: Message) -> None:
        now_s = self.vehicle.time_s
        delivery = self._delivery
        if message.seqno == _START:
            if message.status != mavlink.MAV_REMOTE_LOG_DATA_BLOCK_ACK:
                return
            if delivery is not None and delivery.peer is peer and now_s - delivery.start_s < _SAME_START_S:
                return
            stream = self.vehicle.recording.start_stream()
            if stream is not None:
                self._delivery = _Delivery(stream, peer, message.get_srcSystem(), message.get_srcComponent(), now_s)
        elif delivery is None or delivery.peer is not peer:
            return
        elif message.seqno == _STOP:
            if delivery.stream is self.vehicle.recording.stream:
                self.vehicle.recording.stop_stream()
        elif message.status == mavlink.MAV_REMOTE_LOG_DATA_BLOCK_ACK:
            delivery.stream.acknowledged(message.seqno, now_s)
        else:
            delivery.stream.refused(message.seqno, now_s)

    def _send_blocks(self, now_s: float) -> None:
        delivery = self._delivery
        if delivery is None:
            return
        stream = delivery.stream
        failure = stream.failure(now_s)
        if delivery.peer.address not in self._peers:
            failure = "the ground hung up"
        if stream.delivered or failure is not None:
            self._delivery = None
            if failure is not None and stream is self.vehicle.recording.stream:
                self.vehicle.recording.drop_stream(failure)
        elif self.link.room(delivery.peer.address):
            self._send_each(delivery, stream.due(now_s))

    @staticmethod
    def _send_each(delivery: _Delivery, blocks: list[tuple[int, bytes]]) -> None:
        for number, data in blocks:
            delivery.peer.logger.send(
                mavlink.MAVLink_remote_log_data_block_message(delivery.system, delivery.component, number, data)
            )
