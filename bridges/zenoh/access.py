"""The access-control list of a team's routers: each certificate may speak under its own name only.

Everything that no rule allows is denied, in both directions. A rule has a flow (ingress: what comes from the
process, egress: what goes to it), kinds of messages, and keys. What travels beside a topic's own key under
`@adv` is Zenoh's: heartbeats, caches and tokens of reliable publishers.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from agents.wire.roles import ROLES
from agents.wire.topics import key

_ASKS = ["query", "liveliness_query", "declare_subscriber", "declare_liveliness_subscriber"]
_SAYS = ["put", "reply", "liveliness_token", "declare_queryable"]
_IS_ASKED = ["query", "liveliness_query"]
_KNOWS_WHO_LISTENS = ["declare_subscriber", "declare_liveliness_subscriber"]


@dataclass(frozen=True, slots=True)
class Member:
    """One process that may take part."""

    role: str
    name: str
    common_name: str  # of its certificate


def access_control(team: str, members: Mapping[str, Member]) -> dict[str, Any]:
    """Zenoh's `access_control` for a team's members, by name."""
    rules: list[dict[str, Any]] = []
    policies = []
    for name, member in sorted(members.items()):
        role = ROLES[member.role]
        said = [k for topic in role.says for k in _with_adv(key(team, topic, name))]
        others = [k for topic in role.says for k in _with_adv(key(team, topic, "*"))]
        heard = [k for topic in role.hears for k in _with_adv(key(team, topic, "*"))]
        token, everyone = key(team, "alive", f"{member.role}/{name}/*"), key(team, "alive", "*/*/*")
        mine = [
            # It says what is its own and asks what it may hear; ...
            _rule(f"{name} says", "ingress", _SAYS, [*said, token]),
            _rule(f"{name} asks", "ingress", _ASKS, [*heard, everyone]),
            # ... it is told what it may hear, and asked for what is its own. A publisher to which nobody's
            # subscription is told sends nothing; subscriptions are to all senders of a topic.
            _rule(f"{name} hears", "egress", _SAYS, [*heard, everyone]),
            _rule(f"{name} is asked", "egress", _IS_ASKED, [*others, everyone]),
            _rule(f"{name} is listened to", "egress", _KNOWS_WHO_LISTENS, [*others, everyone]),
        ]
        rules += mine
        policies.append({"rules": [rule["id"] for rule in mine], "subjects": [name]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [
            {"id": name, "cert_common_names": [member.common_name]}
            for name, member in sorted(members.items())
        ],
        "policies": policies,
    }


def _with_adv(topic_key: str) -> list[str]:
    return [topic_key, f"{topic_key}/@adv/**"]


def _rule(name: str, flow: str, messages: list[str], keys: list[str]) -> dict[str, Any]:
    return {"id": name, "permission": "allow", "flows": [flow], "messages": messages, "key_exprs": keys}
