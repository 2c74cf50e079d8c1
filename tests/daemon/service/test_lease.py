"""The lease: exclusive, expiring, and never given twice at a time."""

import math
from itertools import count

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.service.lease import Lease, secret_token

S = 1_000_000_000


def lease(duration_s: float = 2.0) -> Lease:
    numbers = count(1)
    return Lease(duration_s, lambda: f"token {next(numbers)}")


def test_the_first_who_asks_has_it_and_others_do_not() -> None:
    one = lease()
    token = one.acquire("alice", "", 0)
    assert token == "token 1"
    assert one.holder(0) == "alice"
    assert one.holds(token, "alice", S)
    assert one.acquire("bob", "", S) is None
    assert one.acquire("bob", token, S) is None
    assert not one.holds(token, "bob", S)


def test_it_belongs_to_the_token_so_a_second_window_of_the_same_user_waits_too() -> None:
    one = lease()
    one.acquire("alice", "", 0)
    assert one.acquire("alice", "", S) is None
    assert one.acquire("alice", "guessed", S) is None
    assert not one.holds("", "alice", S)


def test_renewal_with_the_token_makes_it_last() -> None:
    one = lease()
    token = one.acquire("alice", "", 0)
    assert token is not None
    for second in range(1, 20):
        assert one.acquire("alice", token, second * S) == token
    assert one.expires_in_s(19 * S) == pytest.approx(2.0)
    assert one.expires_in_s(20 * S) == pytest.approx(1.0)


def test_it_runs_out_and_can_then_be_had_by_somebody_else() -> None:
    one = lease()
    token = one.acquire("alice", "", 0)
    assert token is not None
    assert one.holds(token, "alice", 2 * S - 1)
    assert not one.holds(token, "alice", 2 * S)
    assert one.holder(2 * S) is None
    assert one.expires_in_s(2 * S) is None
    assert one.acquire("bob", "", 2 * S) == "token 2"
    assert one.acquire("alice", token, 2 * S) is None


def test_a_renewal_that_comes_too_late_gets_a_new_token() -> None:
    one = lease()
    token = one.acquire("alice", "", 0)
    assert token is not None
    assert one.acquire("alice", token, 2 * S) == "token 2"
    assert not one.holds(token, "alice", 2 * S)


def test_only_its_holder_can_give_it_back() -> None:
    one = lease()
    token = one.acquire("alice", "", 0)
    assert token is not None
    assert not one.release("guessed", "alice", S)
    assert not one.release(token, "bob", S)
    assert one.release(token, "alice", S)
    assert not one.release(token, "alice", S)
    assert one.holder(S) is None
    assert one.acquire("bob", "", S) == "token 2"


def test_how_long_nobody_has_had_it() -> None:
    one = lease()
    assert one.unheld_s(5 * S) == math.inf
    token = one.acquire("alice", "", 0)
    assert token is not None
    assert one.unheld_s(S) == 0.0
    assert one.unheld_s(5 * S) == pytest.approx(3.0)
    token = one.acquire("alice", "", 5 * S)
    assert token is not None
    assert one.unheld_s(5 * S) == 0.0
    one.release(token, "alice", 6 * S)
    assert one.unheld_s(8 * S) == pytest.approx(2.0)


@given(
    st.lists(
        st.tuples(
            st.sampled_from(["acquire", "renew", "release", "steal"]),
            st.sampled_from(["alice", "bob", "carol"]),
            st.integers(0, 3 * S),
        ),
        max_size=40,
    )
)
def test_at_no_time_do_two_tokens_hold_it(steps: list[tuple[str, str, int]]) -> None:
    one, t_ns = lease(), 0
    tokens: dict[str, str] = {}
    given_out: list[tuple[str, str]] = []
    for what, user, later_ns in steps:
        t_ns += later_ns
        token = tokens.get(user, "")
        if what == "steal":
            token = next((t for u, t in given_out if u != user), "")
        if what == "release":
            one.release(token, user, t_ns)
        else:
            before = one.holder(t_ns)
            got = one.acquire(user, "" if what == "acquire" else token, t_ns)
            if got is not None:
                assert before in (None, user)
                tokens[user] = got
                given_out.append((user, got))
        holding = {(u, t) for u, t in given_out if one.holds(t, u, t_ns)}
        assert len(holding) <= 1
        assert (one.holder(t_ns) is None) == (not holding)
        assert (one.unheld_s(t_ns) == 0.0) or not holding


@pytest.mark.parametrize("duration_s", [0.0, -1.0, math.inf, math.nan])
def test_a_lease_for_ever_or_for_no_time_makes_no_sense(duration_s: float) -> None:
    with pytest.raises(ValueError, match="positive time"):
        Lease(duration_s)


def test_tokens_are_not_repeated() -> None:
    assert len({secret_token() for _ in range(1000)}) == 1000
