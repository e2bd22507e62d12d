"""The keys that a process of a guarded team reads: where they lie, and whether they are any good.

A directory of keys has one directory for each process, named as the process, with `cert.pem`, `key.pem` and
the authority's `ca.pem`; the router's also holds `access.json`. A computer needs only those of the processes
that run on it. `searchparty keys` writes them (bridges.keys.keys).
"""

import os
import stat
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from agents.errors import JoinError

AUTHORITY, CERTIFICATE, KEY, ACCESS = "ca.pem", "cert.pem", "key.pem", "access.json"
ROUTER = "router"


@dataclass(frozen=True, slots=True)
class Credentials:
    """The files of one process, checked."""

    authority: Path
    certificate: Path
    key: Path


def credentials(directory: str | Path, name: str) -> Credentials:
    """The files of a process, after a look at what would else end in silence on the network.

    Raises:
        JoinError: if a file is missing, unreadable or no good, with what to do about it.
    """
    own = Path(directory) / name
    found = Credentials(own / AUTHORITY, own / CERTIFICATE, own / KEY)
    for path in (found.authority, found.certificate, found.key):
        _readable(path, name)
    mode = stat.S_IMODE(found.key.stat().st_mode)
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise JoinError(f"{found.key} may be read by others (mode {mode:o}): chmod 600 {found.key}")
    _check(found, name)
    return found


def _readable(path: Path, name: str) -> None:
    try:
        with path.open("rb"):
            pass
    except FileNotFoundError:
        raise JoinError(
            f"{path} is missing: make the team's keys with `searchparty keys MISSION` and bring the "
            f"directory {name}/ to this computer, or correct link.keys in the mission"
        ) from None
    except OSError as error:
        raise JoinError(
            f"{path} cannot be read: {error.strerror}; it must belong to the user who starts {name}"
        ) from None


def _check(found: Credentials, name: str) -> None:
    """Whether certificate, key and authority belong together, are in force, and are this process's."""
    from cryptography import exceptions, x509  # noqa: PLC0415 - only guarded teams pay for it
    from cryptography.hazmat.primitives import serialization  # noqa: PLC0415

    from bridges.keys.certificates import common_name  # noqa: PLC0415

    try:
        certificate = x509.load_pem_x509_certificate(found.certificate.read_bytes())
        authority = x509.load_pem_x509_certificate(found.authority.read_bytes())
        key = serialization.load_pem_private_key(found.key.read_bytes(), None)
    except (ValueError, TypeError, exceptions.UnsupportedAlgorithm) as error:
        raise JoinError(
            f"{found.certificate.parent} holds a file that is no key or certificate ({error}): "
            f"make it again with `searchparty keys MISSION --renew {name}`"
        ) from None
    if key.public_key() != certificate.public_key():
        raise JoinError(
            f"{found.key} is not the key of {found.certificate}: copy the whole directory {name}/ again"
        )
    whose = common_name(certificate).rpartition(".")[0]
    if whose != name:
        raise JoinError(
            f"{found.certificate} is the certificate of {whose or 'nobody'}, not of {name}: "
            f"bring the directory {name}/ to this computer"
        )
    try:
        certificate.verify_directly_issued_by(authority)
    except (ValueError, TypeError, exceptions.InvalidSignature):
        raise JoinError(
            f"{found.certificate} was not issued by {found.authority}: copy the whole directory {name}/ again"
        ) from None
    now = datetime.now(UTC)
    for path, dated in ((found.certificate, certificate), (found.authority, authority)):
        if now > dated.not_valid_after_utc:
            raise JoinError(
                f"{path} expired on {dated.not_valid_after_utc:%Y-%m-%d %H:%M} UTC: renew it with "
                f"`searchparty keys MISSION --renew {name}` (or set this computer's clock: it shows "
                f"{now:%Y-%m-%d %H:%M} UTC)"
            )
        if now < dated.not_valid_before_utc:
            raise JoinError(
                f"{path} is not valid before {dated.not_valid_before_utc:%Y-%m-%d %H:%M} UTC, and this "
                f"computer's clock shows {now:%Y-%m-%d %H:%M} UTC: set it"
            )


def private_directory(path: Path) -> None:
    """Make a directory that only its owner may look into."""
    path.mkdir(mode=0o700, parents=True, exist_ok=True)
    path.chmod(0o700)


def write_private(path: Path, content: bytes) -> None:
    """A file that only its owner may read, replaced in one go."""
    draft = path.with_name(path.name + ".new")
    draft.unlink(missing_ok=True)
    handle = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(handle, "wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    draft.replace(path)
