"""Certificates and their files: made right, checked before use, and told of in one sentence when wrong."""

import json
import socket
import stat
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID
from typer.testing import CliRunner

from agents import cli
from agents.errors import DataError, JoinError, LinkError, MissionError, StorageError
from agents.mission.mission_file import WrongMissionError, dumps, load
from bridges.keys.certificates import common_name, hosts_of
from bridges.keys.keyring import credentials
from bridges.keys.workshop import Workshop
from bridges.zenoh.access import Member, access_control
from tests.agents.fakes import mission
from tests.bridges.guarded import DAY, disguise, make_keys


def certificate(directory: Path, name: str) -> x509.Certificate:
    return x509.load_pem_x509_certificate((directory / name / "cert.pem").read_bytes())


def test_every_process_gets_its_own_certificate_that_serves_one_end_only(tmp_path: Path) -> None:
    make_keys(tmp_path, hosts=["192.0.2.7", "base.local"])
    for name in ("r1", "r2", "fusion", "watch", "status", "operator", "swarm", "router"):
        found = certificate(tmp_path, name)
        assert common_name(found) == f"{name}.1"
        uses = list(found.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value)
        server = name == "router"
        assert uses == [ExtendedKeyUsageOID.SERVER_AUTH if server else ExtendedKeyUsageOID.CLIENT_AUTH]
        assert credentials(tmp_path, name).certificate == tmp_path / name / "cert.pem"
    assert hosts_of(certificate(tmp_path, "router")) == [
        "localhost",
        "127.0.0.1",
        "::1",
        "192.0.2.7",
        "base.local",
    ]


def test_keys_can_be_read_by_their_owner_only_and_the_authoritys_stays_in_ca(tmp_path: Path) -> None:
    make_keys(tmp_path)
    for path in tmp_path.rglob("*"):
        assert stat.S_IMODE(path.stat().st_mode) == (0o700 if path.is_dir() else 0o600), path
    authority = (tmp_path / "ca" / "ca.key").read_bytes()
    others = [path for path in tmp_path.rglob("*") if path.is_file() and path.parent.name != "ca"]
    assert others
    assert all(authority not in path.read_bytes() for path in others)


def test_made_again_everything_is_kept(tmp_path: Path) -> None:
    make_keys(tmp_path)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    workshop = Workshop.open(tmp_path, mission(2), datetime.now(UTC), 30.0)
    assert workshop.issue([]) == []
    workshop.write()
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_a_new_robot_a_new_host_and_what_has_expired_get_new_certificates(tmp_path: Path) -> None:
    make_keys(tmp_path, days=1.0, ago=2 * DAY)
    workshop = Workshop.open(tmp_path, mission(3), datetime.now(UTC), 30.0)
    assert set(workshop.issue([])) == set(workshop.members)
    assert "r3" in workshop.members
    assert workshop.issue(["192.0.2.9"]) == ["router"] or "router" in workshop.issue(["192.0.2.10"])
    assert "192.0.2.9" in hosts_of(certificate(tmp_path, "router"))


def test_a_renewed_certificate_takes_the_old_ones_place_in_the_access_list(tmp_path: Path) -> None:
    make_keys(tmp_path)
    workshop = Workshop.open(tmp_path, mission(2), datetime.now(UTC), 30.0)
    workshop.renew("r1")
    workshop.revoke("r2")
    assert workshop.issue([]) == ["r1"]
    workshop.write()
    access = json.loads((tmp_path / "router" / "access.json").read_text())
    let_in = {subject["id"]: subject["cert_common_names"] for subject in access["subjects"]}
    assert let_in["r1"] == ["r1.2"]
    assert "r2" not in let_in
    assert common_name(certificate(tmp_path, "r1")) == "r1.2"
    again = Workshop.open(tmp_path, mission(2), datetime.now(UTC), 30.0)
    again.issue([])
    assert again.members["r2"].revoked, "revoked for good, not until the next call"


def test_the_access_list_lets_a_robot_say_only_what_is_its_own() -> None:
    access = access_control("t", {"r1": Member("robot", "r1", "r1.1")})
    assert access["default_permission"] == "deny"
    assert access["enabled"] is True
    said = [rule for rule in access["rules"] if rule["flows"] == ["ingress"] and "put" in rule["messages"]]
    keys = [key for rule in said for key in rule["key_exprs"]]
    assert "t/v1/set/r1" in keys
    assert all("/r1/" in f"{key}/" for key in keys)
    assert not [key for key in keys if key.startswith(("t/v1/truth", "t/v1/posterior", "t/v1/start"))]
    policy = {name for entry in access["policies"] for name in entry["rules"]}
    assert policy == {rule["id"] for rule in access["rules"]}


def expired(keys: Path) -> None:
    make_keys(keys, days=1.0, ago=2 * DAY)


def not_yet(keys: Path) -> None:
    make_keys(keys, ago=-3 * DAY)


def missing(keys: Path) -> None:
    make_keys(keys)
    (keys / "r1" / "key.pem").unlink()


def open_to_all(keys: Path) -> None:
    make_keys(keys)
    (keys / "r1" / "key.pem").chmod(0o644)


def of_another(keys: Path) -> None:
    make_keys(keys)
    disguise(keys, "r1", "r2")


def mixed(keys: Path) -> None:
    make_keys(keys)
    (keys / "r1" / "key.pem").write_bytes((keys / "r2" / "key.pem").read_bytes())


def another_authority(keys: Path) -> None:
    make_keys(keys)
    make_keys(keys / "others")
    (keys / "r1" / "ca.pem").write_bytes((keys / "others" / "r1" / "ca.pem").read_bytes())


def garbage(keys: Path) -> None:
    make_keys(keys)
    (keys / "r1" / "cert.pem").write_bytes(b"-----BEGIN NOTHING-----")


@pytest.mark.parametrize(
    ("mistake", "words"),
    [
        (expired, r"cert\.pem expired on .* renew it with `searchparty keys MISSION --renew r1`"),
        (not_yet, r"not valid before .* clock shows .* set it"),
        (missing, r"key\.pem is missing: make the team's keys with `searchparty keys MISSION`"),
        (open_to_all, r"may be read by others \(mode 644\): chmod 600"),
        (of_another, r"is the certificate of r2, not of r1: bring the directory r1/"),
        (mixed, r"is not the key of .*copy the whole directory r1/"),
        (another_authority, r"was not issued by .*copy the whole directory r1/"),
        (garbage, r"holds a file that is no key or certificate"),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_a_mistake_is_one_sentence_that_says_what_to_do(tmp_path: Path, mistake: object, words: str) -> None:
    assert callable(mistake)
    mistake(tmp_path)
    with pytest.raises(JoinError, match=words) as raised:
        credentials(tmp_path, "r1")
    assert "\n" not in str(raised.value)


def test_keys_of_another_team_and_a_lost_authority_are_not_written_over(tmp_path: Path) -> None:
    make_keys(tmp_path)
    before = (tmp_path / "r1" / "cert.pem").read_bytes()
    with pytest.raises(DataError, match="keys of the team 't', and this mission's is 'other'"):
        Workshop.open(tmp_path, mission(2, team="other"), datetime.now(UTC), 30.0)
    (tmp_path / "ca" / "ca.key").unlink()
    with pytest.raises(DataError, match=r"authority in .* cannot be read .*bring ca\.key"):
        Workshop.open(tmp_path, mission(2), datetime.now(UTC), 30.0)
    assert (tmp_path / "r1" / "cert.pem").read_bytes() == before


def test_a_place_that_cannot_be_written_and_names_that_clash_are_told(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(StorageError, match="choose another --out"):
        make_keys(blocked / "keys")
    workshop = make_keys(tmp_path / "keys")
    with pytest.raises(MissionError, match="cannot be called 'r1', which is a robot"):
        workshop.enlist("operator", "r1")
    with pytest.raises(MissionError, match="cannot be called 'ca'"):
        workshop.enlist("operator", "ca")
    with pytest.raises(MissionError, match="nearest is r1"):
        workshop.renew("r11")


def test_the_command_says_what_it_made_and_what_to_do_with_it(tmp_path: Path) -> None:
    run = CliRunner()
    out = tmp_path / "keys"
    made = run.invoke(cli.app, ["keys", "quickstart", "--out", str(out), "--hosts", "192.0.2.1"])
    assert made.exit_code == 0, made.output
    until = (datetime.now(UTC) + timedelta(days=365)).strftime("%Y-%m-%d")
    assert f"valid until {until}: router, fusion" in made.output
    assert "192.0.2.1" in made.output
    assert "ca to yourself" in made.output
    assert 'write keys = "keys" into its [link]' in made.output
    again = run.invoke(cli.app, ["keys", "quickstart", "--out", str(out), "--also", "operator:anna"])
    assert "valid until" in again.output
    assert "anna" in again.output
    wrong = run.invoke(cli.app, ["keys", "quickstart", "--out", str(out), "--also", "captain:anna"])
    assert isinstance(wrong.exception, MissionError)


@pytest.mark.parametrize(
    ("link", "key", "words"),
    [
        ('topology = "mesh"\nkeys = "keys"', "link.topology", "star or router"),
        ('endpoints = ["tcp/127.0.0.1:7447"]\nkeys = "keys"', r"link.endpoints\[0\]", "tls/HOST:PORT"),
        ('endpoints = ["tls/127.0.0.1:7447"]', r"link.endpoints\[0\]", "or link.keys"),
    ],
)
def test_a_mission_whose_link_and_keys_do_not_fit_is_wrong(
    tmp_path: Path, link: str, key: str, words: str
) -> None:
    path = guarded_mission(tmp_path, link)
    with pytest.raises(WrongMissionError, match=f"{key}: .*{words}"):
        load(path)


def guarded_mission(directory: Path, link: str) -> Path:
    text = dumps(load("quickstart"))
    path = directory / "m.toml"
    begin, end = text.index("[link]"), text.index("[", text.index("lease_s"))
    path.write_text(f"{text[:begin]}[link]\n{link}\n\n{text[end:]}")
    return path


@pytest.mark.processes
def test_a_router_in_the_field_serves_those_who_have_keys_and_others_are_told_what_they_lack(
    tmp_path: Path,
) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tls/127.0.0.1:{probe.getsockname()[1]}"
    path = guarded_mission(
        tmp_path, f'topology = "router"\nendpoints = ["{endpoint}"]\nkeys = "keys"\nlease_s = 2.0'
    )
    lacking = CliRunner().invoke(cli.app, ["status", str(path)])
    assert isinstance(lacking.exception, JoinError)
    assert "status/ca.pem is missing: make the team's keys" in str(lacking.exception)
    assert CliRunner().invoke(cli.app, ["keys", str(path)]).exit_code == 0
    command = [sys.executable, "-m", "agents.cli", "router", str(path), "--listen", endpoint]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as router:
        try:
            assert router.stdout is not None
            assert router.stdout.readline() == f"open to those who have the team's keys, at {endpoint}\n"
            nobody = CliRunner().invoke(cli.app, ["status", str(path), "--seconds", "1"])
            assert isinstance(nobody.exception, LinkError)
            assert "nobody of the team searchparty is at" in str(nobody.exception)
            router.terminate()
            assert router.wait(10) == 0
        finally:
            router.kill()
