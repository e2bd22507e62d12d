"""A directory of keys in the making: an authority, a register of who has which certificate, and their files.

The authority's private key stays in `ca/`, which no computer of the team needs: whoever has it can make
certificates for anybody. A certificate's common name is NAME.GENERATION, and routers let in only the newest
generation: to renew is to revoke the old one.
"""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

from cryptography import exceptions, x509
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ec

from agents.errors import DataError, MissionError, StorageError
from agents.mission.mission import Mission
from agents.mission.tables import nearest
from bridges.keys.certificates import Pair, authority, common_name, hosts_of, issue
from bridges.keys.keyring import ACCESS, AUTHORITY, CERTIFICATE, KEY, ROUTER, private_directory, write_private
from bridges.zenoh.access import Member, access_control

LOOPBACK = ("localhost", "127.0.0.1", "::1")
HOME, REGISTER, AUTHORITY_KEY = "ca", "register.json", "ca.key"
STANDARD = ("fusion", "swarm", "watch", "status", "operator")  # each process named as its role


@dataclass
class _Member:
    """A row of the register."""

    role: str
    generation: int = 0  # of the newest certificate; 0: none yet
    revoked: bool = False


@dataclass
class Workshop:
    """A directory of keys in the making."""

    directory: Path
    team: str
    authority: Pair
    now: datetime
    days: float
    members: dict[str, _Member] = field(default_factory=dict)  # the router's too
    _renewed: set[str] = field(default_factory=set)

    @classmethod
    def open(cls, directory: Path, mission: Mission, now: datetime, days: float) -> "Workshop":
        """The directory as it is, with everybody of the mission enlisted; a new authority if there is none.

        Raises:
            DataError: if what is there cannot be read or is another team's. StorageError: if it cannot be
                written.
        """
        home = directory / HOME
        with _writing(home):
            private_directory(directory)
            private_directory(home)
        key_file, register = home / AUTHORITY_KEY, home / REGISTER
        if not register.exists() and not key_file.exists():
            made = authority(mission.team, now)
            with _writing(home):
                write_private(key_file, made.key_pem())
                write_private(home / AUTHORITY, made.certificate_pem())
            workshop = cls(directory, mission.team, made, now, days)
        else:
            workshop = cls(directory, mission.team, _read_authority(home), now, days)
            try:
                kept = json.loads(register.read_text())
                workshop.members = {name: _Member(**row) for name, row in kept["members"].items()}
                team = str(kept["team"])
            except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
                raise DataError(
                    f"{register} cannot be read ({error}): restore it, or take another --out"
                ) from None
            if team != mission.team:
                raise DataError(
                    f"{directory} holds the keys of the team {team!r}, and this mission's is "
                    f"{mission.team!r}: take another --out"
                )
        workshop.members.setdefault(ROUTER, _Member(ROUTER))
        for role in STANDARD:
            workshop.enlist(role, role)
        for fusion in mission.fusions():
            workshop.enlist("fusion", fusion)
        for robot in mission.robots:
            workshop.enlist("robot", robot.id)
        return workshop

    def enlist(self, role: str, name: str) -> None:
        """One more process, if it is not known yet.

        Raises:
            MissionError: if the name is another role's.
        """
        known = self.members.setdefault(name, _Member(role))
        if known.role != role or name == HOME:
            taken = "the authority's directory" if name == HOME else f"a {known.role} already"
            raise MissionError(f"a {role} cannot be called {name!r}, which is {taken}: take another name")

    def renew(self, name: str) -> None:
        """Have a new certificate made."""
        self._known(name).revoked = False
        self._renewed.add(name)

    def revoke(self, name: str) -> None:
        """Let nobody of this name in."""
        self._known(name).revoked = True

    def issue(self, hosts: list[str]) -> list[str]:
        """Make what is missing, due or wanted anew; the names of those that got a certificate."""
        router = self.certificate(ROUTER)
        known = [] if router is None else hosts_of(router)
        wanted = list(dict.fromkeys([*LOOPBACK, *known, *hosts]))
        if set(wanted) != set(known):
            self._renewed.add(ROUTER)
        made = []
        for name, member in self.members.items():
            if not member.revoked and (name in self._renewed or self._is_due(name, member)):
                self._issue(name, member, wanted if name == ROUTER else None)
                made.append(name)
        return made

    def certificate(self, name: str) -> x509.Certificate | None:
        """A process's certificate; None if there is none, or not one of this authority's."""
        path = self.directory / name / CERTIFICATE
        try:
            certificate = x509.load_pem_x509_certificate(path.read_bytes())
            certificate.verify_directly_issued_by(self.authority.certificate)
        except (OSError, ValueError, TypeError, exceptions.InvalidSignature):
            return None
        return certificate if path.with_name(KEY).exists() else None

    def _is_due(self, name: str, member: _Member) -> bool:
        """Whether a certificate is missing, has expired, or is not the one that the register knows."""
        found = self.certificate(name)
        return (
            found is None
            or found.not_valid_after_utc <= self.now
            or common_name(found) != _common(name, member)
        )

    def write(self) -> None:
        """The register, and what routers let in."""
        let_in = {
            name: Member(member.role, name, _common(name, member))
            for name, member in self.members.items()
            if name != ROUTER and not member.revoked
        }
        register = {"team": self.team, "members": {name: vars(m) for name, m in self.members.items()}}
        with _writing(self.directory):
            write_private(self.directory / HOME / REGISTER, json.dumps(register, indent=1).encode())
            rules = json.dumps(access_control(self.team, let_in), indent=1).encode()
            write_private(self.directory / ROUTER / ACCESS, rules)

    def _issue(self, name: str, member: _Member, hosts: list[str] | None) -> None:

        member.generation += 1
        try:
            pair = issue(self.authority, _common(name, member), self.team, self.now, self.days, hosts)
        except ValueError as error:  # such as a host name that no certificate can hold
            raise MissionError(f"--hosts: {', '.join(hosts or [])}: {error}") from None
        own = self.directory / name
        with _writing(own):
            private_directory(own)
            write_private(own / KEY, pair.key_pem())
            write_private(own / CERTIFICATE, pair.certificate_pem())
            write_private(own / AUTHORITY, self.authority.certificate_pem())

    def _known(self, name: str) -> _Member:

        if name not in self.members:
            near = nearest(name, self.members)
            hint = f"; nearest is {near}" if near else ""
            raise MissionError(f"{name} is no process of this team: {', '.join(self.members)}{hint}")
        return self.members[name]


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Turn what the disk says into one sentence."""
    try:
        yield
    except OSError as error:
        raise StorageError(f"cannot write {path}: {error.strerror}; choose another --out") from None


def _common(name: str, member: _Member) -> str:
    return f"{name}.{member.generation}"


def _read_authority(home: Path) -> Pair:

    try:
        key = serialization.load_pem_private_key((home / AUTHORITY_KEY).read_bytes(), None)
        certificate = x509.load_pem_x509_certificate((home / AUTHORITY).read_bytes())
    except (OSError, ValueError, TypeError) as error:
        raise DataError(
            f"the authority in {home} cannot be read ({error}): bring {AUTHORITY_KEY} and {AUTHORITY} back "
            "from where you keep them, or make new keys for everybody with another --out"
        ) from None
    assert isinstance(key, ec.EllipticCurvePrivateKey)
    return Pair(certificate, key)
