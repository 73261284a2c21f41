"""Topics on one network interface: the only place that knows how cyclonedds is set up."""

from __future__ import annotations

import socket

from cyclonedds.core import DDSException
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from deploy.messages import Packed
from wt.errors import ConfigError, WorkError

LARGEST_DOMAIN = 230
"""Beyond it, a domain's ports are no longer among those of UDP."""

# Multicast is forced: the loopback interface does not announce that it can do it.
_CONFIG = """<CycloneDDS><Domain Id="any"><General><Interfaces>
<NetworkInterface name="{interface}" multicast="true"/>
</Interfaces></General></Domain></CycloneDDS>"""

_domains: dict[int, tuple[str, Domain]] = {}


class DdsParticipant:
    """A member of one DDS domain on one network interface."""

    def __init__(self, interface: str, domain: int = 0) -> None:
        """Join.

        Args:
            interface: of the network, e.g. ``"eth0"``, or ``"lo"``.
            domain: number of the DDS domain; a Go2's is 0.

        Raises:
            ConfigError: there is no such interface or domain.
            WorkError: the network refuses.
        """
        known = [name for _, name in socket.if_nameindex()]
        if interface not in known:
            raise ConfigError(
                f"there is no network interface {interface!r}; this machine has "
                f"{', '.join(known)}: give one with --interface"
            )
        if not 0 <= domain <= LARGEST_DOMAIN:
            raise ConfigError(f"DDS domain is {domain}; 0 to {LARGEST_DOMAIN} are allowed")
        try:
            _enter(interface, domain)
            self._member = DomainParticipant(domain)
        except DDSException as error:
            raise WorkError(
                f"DDS cannot use the network interface {interface!r} ({error}); is it up, with an "
                "IPv4 address? See: ip address"
            ) from error

    def writer(self, topic: str, kind: type[Packed]) -> DataWriter:
        """A sender of messages of one kind."""
        return DataWriter(self._member, self._topic(topic, kind))

    def inbox(self, topic: str, kind: type[Packed], depth: int = 1) -> Inbox:
        """A receiver of messages, except those that this member sends; keeps the newest few."""
        qos = Qos(Policy.History.KeepLast(depth), Policy.IgnoreLocal.Participant)
        return Inbox(DataReader(self._member, self._topic(topic, kind), qos=qos), depth)

    def _topic(self, name: str, kind: type[Packed]) -> Topic:
        return Topic(self._member, name, kind)


class Inbox:
    """Messages of one topic."""

    def __init__(self, reader: DataReader, depth: int) -> None:
        """Read from ``reader``, which keeps ``depth`` messages."""
        self._reader, self._depth = reader, depth

    def take(self) -> list[Packed]:
        """Messages since the last call, oldest first, at most ``depth``; does not wait."""
        return [m for m in self._reader.take(self._depth) if isinstance(m, Packed)]


def _enter(interface: str, domain: int) -> None:
    """Configure a domain, which a process can do once."""
    if domain not in _domains:
        _domains[domain] = (interface, Domain(domain, _CONFIG.format(interface=interface)))
    if _domains[domain][0] != interface:
        raise ConfigError(
            f"DDS domain {domain} is on {_domains[domain][0]!r} in this process already, not on "
            f"{interface!r}"
        )
