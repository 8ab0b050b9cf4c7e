"""What remains beside named effects, and where a model is as good as it gets."""

from __future__ import annotations

from typing import Any

import pytest
from test_result_shapes import CHANNEL, FRICTION, content

from hdagen.diagnosis.data.data_settings import DATA
from hdagen.diagnosis.holdout.holdout_check_settings import HOLDOUT_CHECK
from hdagen.diagnosis.holdout.unexplained_remainder import is_as_good_as_it_gets, measure_remainders, name_remainders
from hdagen.diagnosis.report.sentences import write_verdict


def channel(before: float, after: float) -> dict[str, float]:
    return {"before": before, "after": after, "noise": 1e-4}


def test_a_joint_is_explained_as_well_as_its_best_channel_is() -> None:
    channels = {
        "motor_position_1": channel(200.0, 100.0),
        "joint_position_1": channel(400.0, 40.0),
        "motor_current_1": channel(2.0, 0.1),  # it did not err: it shows nothing
        "joint_position_2": channel(50.0, 49.0),
        "joint_torque_2": channel(80.0, 20.0),
    }
    assert measure_remainders(channels) == [
        {"joint": 1, "share": pytest.approx(0.1), "noise": 40.0},
        {"joint": 2, "share": pytest.approx(0.25), "noise": 20.0},
    ]
    assert measure_remainders({"motor_current_1": channel(2.0, 2.0)}) == []


@pytest.mark.parametrize(
    ("share", "noise", "said"),
    [
        (HOLDOUT_CHECK.named_remainder_share + 0.01, DATA.significant_noise_multiple + 1.0, True),
        (HOLDOUT_CHECK.named_remainder_share - 0.01, 1000.0, False),  # most of it is explained
        (1.0, DATA.significant_noise_multiple - 1.0, False),  # it is near the noise
    ],
)
def test_much_that_remains_stands_beside_what_is_named(share: float, noise: float, said: bool) -> None:
    remains = [{"joint": 1, "share": 0.01, "noise": 500.0}, {"joint": 2, "share": share, "noise": noise}]
    assert name_remainders([FRICTION], remains) == [FRICTION, *(["unknown@2"] if said else [])]


def test_it_stands_beside_named_effects_alone_and_once() -> None:
    remains = [{"joint": 1, "share": 1.0, "noise": 500.0}]
    assert name_remainders([], remains) == []
    assert name_remainders(["unknown@2"], remains) == ["unknown@2"]
    assert name_remainders([FRICTION, "unknown@1"], remains) == [FRICTION, "unknown@1"]


@pytest.mark.parametrize(
    ("before", "achievable", "good"),
    [(6.9, 6.9, True), (11.1, 10.6, True), (7.7, 5.0, False), (66.0, 64.0, False), (1.1, 1.0, True)],
)
def test_where_nothing_can_be_closed_a_model_is_as_good_as_it_gets(
    before: float, achievable: float, good: bool
) -> None:
    assert is_as_good_as_it_gets({"before": before, "achievable": achievable}) == good


def test_the_sentence_says_what_is_there_and_then_what_remains() -> None:
    remains = [{"joint": 1, "share": 0.41, "noise": 50.0}]
    said = write_verdict(content([FRICTION, "unknown@1"], [[FRICTION]], remains=remains))
    assert said.startswith(
        "Coulomb friction on joint 1 is missing in the model (found 0.100 ± 0.010 N m); probability "
    )
    assert "; probability 0.80, of exactly this set > 0.99" in said
    assert "What no known effect explains remains beside it: 41 % of the error at joint 1." in said
    assert "unknown" not in said
    alone = write_verdict(content(["unknown@1", "unknown@2"], [["unknown@1"]], remains=remains))
    assert alone.startswith("Joints 1, 2 miss something that no known effect explains") and "remains" not in alone


def test_where_nothing_can_be_closed_the_sentence_says_so() -> None:
    gap: dict[str, Any] = {
        "before": 6.9,
        "after": 6.9,
        "flexible": 6.9,
        "achievable": 6.9,
        "shrink": 0.0,
        "interval": None,
    }
    told = content([], [["unknown@1"], []], as_good_as_it_gets=True, gap=gap | {"floor": 1.0, "by_channel": CHANNEL})
    assert write_verdict(told).startswith(
        "The model is as good as it gets here: nothing that was fitted closes much of the gap"
    )
