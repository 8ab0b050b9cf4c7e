"""The search over sets of effects: scan, race, further effects, close calls."""

from __future__ import annotations

from dataclasses import dataclass

from hdagen.support.setting_declaration import declare_setting


@dataclass(frozen=True)
class SearchSettings:
    """The search over sets of effects: scan, race, further effects, close calls."""

    scanned_sizes: tuple[float, ...] = declare_setting(
        (-2.0, -0.7, 0.7, 2.0), "usual sizes", "sizes that are scanned: corners and resonances"
    )
    scanned_torques: tuple[float, float] = declare_setting(
        (0.03, 1.0), "units of residual torque", "sizes of residual torque in the scan: little and much"
    )
    scan_batch_size: int = declare_setting(32, "points", "points that are scored together: time and memory")
    race_sizes: tuple[int, ...] = declare_setting(
        (9, 5, 3), "hypotheses", "hypotheses beside the null model in each round of the race: time"
    )
    further_race_sizes: tuple[int, ...] = declare_setting(
        (5, 3, 2), "hypotheses", "the same for further effects beside a leader: time"
    )
    most_effects_of_set: int = declare_setting(
        3, "effects", "effects at once beside wrong numbers of the robot file: time"
    )
    most_members_of_set: int = declare_setting(7, "effects", "effects and wrong numbers at once: time")
    drive_restarts: int = declare_setting(
        2,
        "starts",
        "further starts of whole drives from the file's other numbers, which moved while frictions and rotors were off",
    )
    number_rounds: int = declare_setting(
        2, "rounds", "rounds in which wrong numbers are chosen: the linear model of the first may miss some"
    )
    dropped_share: float = declare_setting(
        0.1, "of the members", "of all numbers of the file, as many are dropped at once, one at least: time"
    )
    least_evidence_gain: float = declare_setting(
        1.0,
        "temperatures of log evidence",
        "a further effect must promise as much to be fitted: less is within the misfit",
    )
    least_promise_share: float = declare_setting(
        0.05,
        "of the largest promise",
        "another effect must reach as much to be fitted",
        "11 development logs, where the effects named promised 0.61 or more",
    )
    least_lead: float = declare_setting(
        3.0, "temperatures of log evidence", "a larger set must lead by as much: as much may still be gained"
    )
    most_further_steps: int = declare_setting(
        3, "steps", "further steps at most, each for another temperature of log evidence: time"
    )
    refit_rounds: int = declare_setting(
        3, "rounds", "rounds for hypotheses that start at the leader's point: its subsets and look-alikes"
    )
    most_absent_frictions: int = declare_setting(
        3, "frictions", "with more of the ordinary frictions absent beside all of them, no set without one is fitted"
    )
    at_bound_deviations: float = declare_setting(
        2.5, "spike widths", "a nuisance effect is at its bound from here: the slope in a bent valley promises little"
    )
    most_at_bound: int = declare_setting(2, "effects", "nuisance effects at their bound that are tried at most: time")
    look_alike_margin: float = declare_setting(
        40.0,
        "temperatures of log evidence",
        "a look-alike is no further behind the leader, in its linear model: it may not have found the point",
    )
    most_look_alikes: int = declare_setting(3, "sets", "look-alikes at most: time")
    most_equal_motions: int = declare_setting(
        3, "sets", "sets that move the arm as the leader does, with other numbers of the file, at most: time"
    )
    most_equal_motions_tried: int = declare_setting(
        200, "sets", "of these, sets whose mass matrix and weight are compared, the smallest ones first: time"
    )
    compared_poses: int = declare_setting(24, "poses", "poses of the log at which mass matrix and weight are compared")
    most_matching_steps: int = declare_setting(30, "steps", "steps at most to the numbers that make these equal")
    finalist_count: int = declare_setting(2, "hypotheses", "hypotheses beside the null model that go on after the race")
    merging_round: int = declare_setting(2, "round", "after it a set with two starts keeps the better one")
    trailing_share: float = declare_setting(
        1 / 3, "of the leader's gain over the null model", "a hypothesis with less is dropped: time"
    )
    first_round_share: float = declare_setting(
        0.1, "of the leader's gain over the null model", "the same before the first step: time"
    )
    outdone_ratio: float = declare_setting(
        10.0, "times the best one's misfit", "the null model is dropped from here: nothing more can be learned from it"
    )
    hopeless_margin: float = declare_setting(
        20.0,
        "temperatures of log evidence",
        "a hypothesis further behind the leader is not fitted to its end, nor beyond its first step",
    )
    close_call_margin: float = declare_setting(
        10.0,
        "temperatures of log evidence",
        "a hypothesis this near the best is a close call: no decision by who stopped early",
    )
    most_close_calls: int = declare_setting(4, "hypotheses", "close calls that are settled at most: time")
    close_call_steps: int = declare_setting(8, "steps", "further steps of each close call at most: time")
    clean_levels: tuple[float, float] = declare_setting(
        (0.05, 1.02), "units of residual torque; squared noise scale", "below both no large effect is left to be found"
    )
    effect_penalty: float = declare_setting(
        5.0,
        "temperatures of log evidence",
        "the prior of one more effect takes as much, or a little less: the prior's five or six",
    )
    large_misfit_share: float = declare_setting(
        0.25,
        "of the null model's misfit",
        "with more of it left, one effect may stand in for two: the next best set is enlarged, too",
    )
    unexplained_misfit_share: float = declare_setting(
        0.85,
        "of the null model's misfit",
        "with more of it left, no second effect is looked for: no known effect helps",
        "16 logs of two effects, none of which left more than 0.76, and 12 logs of something unknown, 7 of which did",
    )
    unexplained_misfit: float = declare_setting(
        500.0, "nats", "log evidence that must be left, too, for that, as the likelihood is tempered"
    )
    spring_sizes: tuple[float, float] = declare_setting(
        (1.0, 4.0), "usual sizes", "a fit with springs starts at each of them"
    )
    spring_step: float = declare_setting(
        2.5e-4, "s", "stable for springs ten times as stiff as usual ones; a stiffer spring is as good as rigid"
    )


SEARCH = SearchSettings()
