"""The role table against the topic table: what is not in it, no guarded network carries."""

import pytest

from agents.wire.roles import EXCLUSIVE, ROLES
from agents.wire.topics import TOPICS


@pytest.mark.parametrize("topic", TOPICS)
def test_every_topic_is_said_by_somebody_and_heard_by_somebody(topic: str) -> None:
    assert any(topic in role.says for role in ROLES.values()), f"nobody says {topic}: see roles.py"
    assert any(topic in role.hears for role in ROLES.values() if role is not ROLES["watch"])


def test_what_the_team_believes_and_what_is_true_is_for_one_role_to_say() -> None:
    def speakers(topic: str) -> list[str]:
        return [name for name, role in ROLES.items() if topic in role.says]

    assert speakers("posterior") == speakers("start") == speakers("picture") == ["fusion"]
    assert speakers("set") == speakers("pose") == ["robot"]
    assert speakers("truth") == ["swarm"]
    assert "truth" not in ROLES["robot"].hears + ROLES["fusion"].hears


def test_only_who_decides_for_itself_needs_an_id_of_its_own() -> None:
    assert set(EXCLUSIVE) == {"robot", "fusion"}
