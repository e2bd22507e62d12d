"""Why a guarded router cannot be reached, in words: Zenoh only says that it cannot.

One handshake with the standard library's TLS, with the same certificates, tells who of the two refused whom.
"""

import socket
import ssl

from bridges.keys.keyring import Credentials

TIMEOUT_S = 1.0

# OpenSSL's numbers of what can be wrong with the other's certificate.
_EXPIRED, _NOT_YET, _HOST, _ADDRESS = 10, 9, 62, 64


def tls_trouble(endpoints: tuple[str, ...], keys: Credentials) -> str | None:
    """One sentence about the first endpoint that answers and with which TLS fails; None if none does."""
    for endpoint in endpoints:
        protocol, _, address = endpoint.partition("/")
        host, _, port = address.partition("?")[0].rpartition(":")
        host = host.strip("[]")
        if protocol != "tls":
            return f"{endpoint} is not guarded: with link.keys, write endpoints as tls/HOST:PORT"
        try:
            with socket.create_connection((host, int(port)), TIMEOUT_S) as plain:
                trouble = _handshake(plain, endpoint, host, keys)
        except (OSError, ValueError):
            continue
        if trouble is not None:
            return trouble
    return None


def _handshake(plain: socket.socket, endpoint: str, host: str, keys: Credentials) -> str | None:
    context = ssl.create_default_context(cafile=str(keys.authority))
    context.load_cert_chain(keys.certificate, keys.key)
    try:
        with context.wrap_socket(plain, server_hostname=host) as link:
            link.settimeout(TIMEOUT_S)
            link.recv(1)  # what the other side thinks of our certificate comes after our own handshake
    except ssl.SSLCertVerificationError as error:
        return _refused_by_us(error, endpoint, host)
    except ssl.SSLError as error:
        reason = str(error.reason or error).lower().replace("_", " ")
        if "alert" in reason:
            return (
                f"the router at {endpoint} refuses {keys.certificate} ({reason}): it belongs to other keys "
                "than the router's; bring both from the same directory of keys"
            )
        return f"{endpoint} does not speak TLS ({reason}): start `searchparty router` there, or correct it"
    except OSError:
        pass
    return None


def _refused_by_us(error: ssl.SSLCertVerificationError, endpoint: str, host: str) -> str:
    if error.verify_code in (_HOST, _ADDRESS):
        return (
            f"the router's certificate is not for {host}: make it anew with "
            f"`searchparty keys MISSION --hosts {host}`, or write another of its names into link.endpoints"
        )
    if error.verify_code == _EXPIRED:
        return "the router's certificate has expired: `searchparty keys MISSION --renew router`"
    if error.verify_code == _NOT_YET:
        return "the router's certificate is not valid yet: set this computer's clock, or the router's"
    return (
        f"what answers at {endpoint} is not this team's router ({error.verify_message}): its certificate is "
        "not of the team's authority; correct link.endpoints, or bring it the keys of the same directory"
    )
