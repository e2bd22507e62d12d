"""A state survives its bytes with every bit and every stride, and bytes make nothing but states."""

from dataclasses import dataclass, replace
from typing import Any

import msgpack
import numpy as np
import pytest

from agents.errors import DataError
from agents.ledger.history import key
from agents.ledger.snapshot import Snapshots, fingerprint
from agents.machine import Heard
from agents.wire.topics import SET
from estimator.filter import Area, Filter
from estimator.gaussian.gm_phd import GmPhd
from estimator.lmb.lmb import Lmb
from tests.agents.ledger_story import Stage, story, team


@dataclass(frozen=True)
class Nested:
    """A state with everything in it that one may have."""

    value: Any
    area: Area | None = None


def through(value: Any, initial: Any = None) -> Any:
    snapshots = Snapshots(initial if initial is not None else Nested(None), "f")
    return snapshots.decode(snapshots.encode(value))


@pytest.mark.parametrize(
    "array",
    [
        np.array([0.1, -0.0, 5e-324, 1e308]),
        np.arange(24.0).reshape(2, 3, 4),
        np.asfortranarray(np.arange(12.0).reshape(3, 4)),
        np.arange(24.0).reshape(4, 6)[1:, ::2],
        np.arange(24.0).reshape(4, 6)[::-1, ::-3],
        np.arange(6).reshape(2, 3).T,
        np.zeros((0, 3)),
        np.array(3.5),
        np.array([True, False]),
        np.broadcast_to(np.arange(3.0), (4, 3)),
    ],
    ids=lambda array: f"{array.dtype}{array.shape}{array.strides}",
)
def test_arrays_keep_every_bit_and_stride(array: np.ndarray[Any, Any]) -> None:
    again = through(Nested(array)).value
    assert again.dtype == array.dtype
    assert again.shape == array.shape
    assert array.size == 0 or again.strides == array.strides
    assert again.tobytes() == array.tobytes()


def test_plain_values_and_containers_keep_their_types() -> None:
    value = (1, -2.5, "text", b"bytes", None, True, [1.0, (2,)], {"a": 1, 2: [np.float64(0.1)]})
    again = through(Nested(value)).value
    assert again == value
    assert type(again[7][2][0]) is np.float64


def test_what_both_sides_have_is_not_sent_but_is_the_same_object_again() -> None:
    area = Area(np.zeros(2), np.full(2, 1e3), map=None)
    initial = Nested(np.zeros(3), area)
    state = replace(initial, value=np.ones(3))
    snapshots = Snapshots(initial, "f")
    again = snapshots.decode(snapshots.encode(state))
    assert again.area is area
    np.testing.assert_array_equal(again.value, state.value)


@pytest.mark.parametrize("kind", ["smc_phd", "gm_phd", "lmb"])
def test_every_filters_state_goes_on_with_the_same_bits(kind: str) -> None:
    """Half the story, through bytes, and the other half: as if nothing had been."""
    search = team().search()
    if kind != "smc_phd":
        other: Filter[Any] = GmPhd(GmPhd.Config()) if kind == "gm_phd" else Lmb(Lmb.Config())
        search.filter = other
    rng = np.random.default_rng(0)
    initial = search.init(rng)
    snapshots = Snapshots(initial, "f")
    sensors = team().sensor_models
    whole = halved = initial
    for i, entry in enumerate(story()[:60]):
        if i == 30:
            halved = snapshots.decode(snapshots.encode(halved))
        draws = [np.random.default_rng(i) for _ in range(2)]
        arguments = (sensors[entry.sender], entry.pose, entry.measurements, entry.time)  # type: ignore[union-attr]
        whole = search.apply(whole, *arguments, draws[0])
        halved = search.apply(halved, *arguments, draws[1])
    assert snapshots.encode(halved) == snapshots.encode(whole)


def test_bytes_of_other_code_another_mission_or_a_damaged_disk_are_refused() -> None:
    snapshots = Snapshots(Nested(None), "one")
    payload = snapshots.encode(Nested(np.arange(3.0)))
    with pytest.raises(DataError, match="other code or of another mission"):
        Snapshots(Nested(None), "two").decode(payload)
    for place in (5, 40, len(payload) - 1):
        damaged = bytearray(payload)
        damaged[place] ^= 1
        with pytest.raises(DataError, match="damaged"):
            snapshots.decode(bytes(damaged))


@pytest.mark.parametrize(
    "tree",
    [
        ["c", "os", "system", []],
        ["c", "subprocess", "Popen", []],
        ["c", "agents.ledger.ledger", "Ledger", []],
        ["c", "no.such", "Thing", []],
        ["a", "|O", [1], None, 0, b"12345678"],
        ["a", "<f8", [1000000], None, 0, b"12345678"],
        ["r", 77],
        ["x"],
        [],
    ],
)
def test_bytes_make_nothing_but_states(tree: list[Any]) -> None:
    from hashlib import sha256

    packed = msgpack.packb([1, "f", tree])
    with pytest.raises(DataError, match="not a state"):
        Snapshots(Nested(None), "f").decode(sha256(packed).digest() + packed)


def test_what_is_no_state_is_named() -> None:
    with pytest.raises(TypeError, match="cannot hold a object"):
        through(Nested(object()))


def test_the_fingerprint_is_of_mission_seed_and_code() -> None:
    mission, filter = team().mission, team().filter
    first = fingerprint(mission, 1, filter)
    assert first == fingerprint(mission, 1, filter)
    assert first != fingerprint(mission, 2, filter)
    assert first != fingerprint(team(rollback_s=1.0).mission, 1, filter)
    assert first != fingerprint(mission, 1, Nested(None))


def test_a_checkpoint_of_other_code_is_left_alone_and_the_sets_are_applied_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("agents.fusion.estimate.MARK_EVERY", 32)
    stage = Stage(team())
    for entry in story():
        stage.step(1e3, Heard(SET, entry))
    assert len(stage.ledger.checkpoints()) >= 2
    before = stage.posterior()
    monkeypatch.setattr("tests.agents.ledger_story.FINGERPRINT", "another")
    stage.begin()
    assert stage.posterior() == before
    assert key(story()[-1]) == stage.fusion.estimate._timeline.newest
