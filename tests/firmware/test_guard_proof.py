"""hda_limit proved for every double: z3 holds the claims, and the very expression proved is run beside the C.

`limiter` is written once over z3's Float64, additions included (no abstraction). `evaluate` walks that expression over
numpy, so that what is compared with the C bit by bit is what was proved, not a second transcription.
"""

from __future__ import annotations

import ctypes as ct
import itertools
import math
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
import z3
from guard_library import Library

DOUBLE, NEAREST = z3.Float64(), z3.RNE()
ZERO = z3.FPVal(0.0, DOUBLE)
wanted_bits = z3.BitVec("wanted", 64)
wanted = z3.fpBVToFP(wanted_bits, DOUBLE)
last, limit, step = (z3.FP(name, DOUBLE) for name in ("last", "limit", "step"))
low, high = z3.fpSub(NEAREST, last, step), z3.fpAdd(NEAREST, last, step)


def finite_bits(bits: Any) -> Any:
    """hda_finite."""
    return z3.Extract(62, 52, bits) != z3.BitVecVal(0x7FF, 11)


def finite(x: Any) -> Any:
    """IEEE 754's own notion."""
    return z3.Not(z3.Or(z3.fpIsNaN(x), z3.fpIsInf(x)))


def clamp(x: Any, least: Any, most: Any) -> Any:
    """hda_limit's pair of comparisons: a NaN passes through."""
    x = z3.If(z3.fpGT(x, most), most, x)
    return z3.If(z3.fpLT(x, least), least, x)


def limiter() -> Any:
    """hda_limit: finite, then size, then rate."""
    return clamp(clamp(z3.If(finite_bits(wanted_bits), wanted, ZERO), z3.fpNeg(limit), limit), low, high)


def clamp_before_check() -> Any:
    """The order that bites: fmin(fmax(wanted, -limit), limit) drops a NaN, and the check comes too late."""
    clamped = z3.fpMin(z3.fpMax(wanted, z3.fpNeg(limit)), limit)
    return clamp(z3.If(finite(clamped), clamped, ZERO), low, high)


def rate_before_size() -> Any:
    """Rate, then size: fine where last is within the limit, and the check of finite left out."""
    return clamp(clamp(wanted, low, high), z3.fpNeg(limit), limit)


PRECONDITION = z3.And(
    finite(limit),
    z3.fpGT(limit, ZERO),
    finite(step),
    z3.fpGEQ(step, ZERO),
    finite(last),
    z3.fpLEQ(z3.fpAbs(last), limit),
)
CLAIMS: dict[str, Callable[[Any], Any]] = {
    "is finite": finite,
    "is within the limit": lambda out: z3.fpLEQ(z3.fpAbs(out), limit),
    "is within the rate": lambda out: z3.And(z3.fpLEQ(low, out), z3.fpLEQ(out, high)),
    "falls where wanted is not finite": lambda out: z3.Implies(
        z3.Not(finite(wanted)), z3.fpLEQ(z3.fpAbs(out), z3.fpAbs(last))
    ),
    "is wanted where that is legal": lambda out: z3.Implies(
        z3.And(z3.fpLEQ(z3.fpAbs(wanted), limit), z3.fpLEQ(low, wanted), z3.fpLEQ(wanted, high)), out == wanted
    ),
    "is no step away from wanted": lambda out: z3.And(
        z3.Implies(z3.fpLEQ(last, wanted), z3.Or(z3.Not(finite(wanted)), z3.fpLEQ(last, out))),
        z3.Implies(z3.fpLEQ(wanted, last), z3.Or(z3.Not(finite(wanted)), z3.fpLEQ(out, last))),
    ),
}


def counterexample(claim: Any) -> z3.ModelRef | None:
    """Doubles that break the claim under the precondition, or None where there are none."""
    solver = z3.SolverFor("QF_FPBV")
    solver.set("timeout", 300_000)  # ms; seconds on an idle machine
    solver.add(PRECONDITION, z3.Not(claim))
    answer = solver.check()
    assert answer != z3.unknown, f"z3 gave up: {solver.reason_unknown()}"
    return solver.model() if answer == z3.sat else None


@pytest.mark.parametrize("claim", CLAIMS)
def test_for_every_double_the_limited_torque(claim: str) -> None:
    assert counterexample(CLAIMS[claim](limiter())) is None


def test_the_bit_test_of_finite_is_right_for_every_double() -> None:
    assert counterexample(finite_bits(wanted_bits) == finite(wanted)) is None


@pytest.mark.parametrize(
    "order, claim", [(clamp_before_check, "falls where wanted is not finite"), (rate_before_size, "is finite")]
)
def test_z3_finds_the_fault_of_a_wrong_order(order: Callable[[], Any], claim: str) -> None:
    found = counterexample(CLAIMS[claim](order()))
    assert found is not None
    bits = found.eval(wanted_bits, model_completion=True).as_long()
    assert bits >> 52 & 0x7FF == 0x7FF, "only a wanted torque that is not finite can break it"


def test_clamp_before_check_turns_nan_into_full_torque() -> None:
    """What z3 finds is what C does: fmin(fmax(nan, -5), 5) is -5."""
    columns = {
        "wanted": np.array([math.nan]),
        "last": np.array([0.0]),
        "limit": np.array([5.0]),
        "step": np.array([10.0]),
    }
    assert abs(evaluate(clamp_before_check(), columns)[0]) == 5.0
    assert evaluate(limiter(), columns)[0] == 0.0


@np.errstate(all="ignore")
def evaluate(expression: Any, columns: dict[str, np.ndarray]) -> Any:
    """The z3 expression over numpy doubles, node by node; an operation that is not listed is an error."""
    done: dict[int, Any] = {}

    def value(e: Any) -> Any:
        if e.get_id() not in done:
            done[e.get_id()] = apply(e)
        return done[e.get_id()]

    def apply(e: Any) -> Any:
        kind, args = e.decl().kind(), [value(x) for x in e.children() if not z3.is_fprm(x)]
        if kind == z3.Z3_OP_UNINTERPRETED:
            column = columns[e.decl().name()]
            return column.view(np.uint64) if z3.is_bv(e) else column
        if z3.is_fp_value(e):
            return np.float64(eval_constant(e))
        if kind == z3.Z3_OP_BNUM:
            return np.uint64(e.as_long())
        if kind == z3.Z3_OP_EXTRACT:
            top, bottom = e.params()
            return args[0] >> np.uint64(bottom) & np.uint64((1 << (top - bottom + 1)) - 1)
        return OPERATIONS[kind](*args)

    return value(expression)


def eval_constant(e: Any) -> float:
    """A numeral of Float64 as Python's."""
    bits = z3.simplify(z3.fpToIEEEBV(e)).as_long()
    return float(np.uint64(bits).view(np.float64))


OPERATIONS: dict[int, Callable[..., Any]] = {
    z3.Z3_OP_FPA_ADD: np.add,
    z3.Z3_OP_FPA_SUB: np.subtract,
    z3.Z3_OP_FPA_NEG: np.negative,
    z3.Z3_OP_FPA_GT: np.greater,
    z3.Z3_OP_FPA_LT: np.less,
    z3.Z3_OP_FPA_MIN: np.fmin,
    z3.Z3_OP_FPA_MAX: np.fmax,
    z3.Z3_OP_FPA_IS_NAN: np.isnan,
    z3.Z3_OP_FPA_IS_INF: np.isinf,
    z3.Z3_OP_FPA_TO_FP: lambda bits: bits.view(np.float64),
    z3.Z3_OP_ITE: np.where,
    z3.Z3_OP_EQ: np.equal,
    z3.Z3_OP_DISTINCT: np.not_equal,
    z3.Z3_OP_NOT: np.logical_not,
    z3.Z3_OP_OR: np.logical_or,
}

EDGES = np.array(
    [
        *(0, 1, 2, 0x000FFFFFFFFFFFFF, 0x0010000000000000, 0x0010000000000001),  # zero, denormals, the smallest normals
        *(
            0x3CB0000000000000,
            0x3FEFFFFFFFFFFFFF,
            0x3FF0000000000000,
            0x3FF0000000000001,
            0x4014000000000000,
        ),  # about 1
        *(0x7FEFFFFFFFFFFFFE, 0x7FEFFFFFFFFFFFFF, 0x7FF0000000000000),  # the largest, infinity
        *(0x7FF0000000000001, 0x7FF4000000000000, 0x7FF8000000000000, 0x7FF8DEADBEEF0001, 0x7FFFFFFFFFFFFFFF),  # NaN
    ],
    dtype=np.uint64,
)


def hostile_columns(count: int, seed: int) -> dict[str, np.ndarray]:
    """Bit patterns that satisfy the precondition: every mix of edges, any bits at all, and torques of ordinary size."""
    random = np.random.default_rng(seed)
    signed = np.concatenate([EDGES, EDGES | np.uint64(1 << 63)])
    mixes = np.array(list(itertools.product(signed, signed, EDGES, EDGES)), dtype=np.uint64)
    mixes = mixes[random.permutation(len(mixes))]
    bits = random.integers(0, 2**64, (count, 4), dtype=np.uint64)
    ordinary = random.normal(size=(count, 4)) * 10.0 ** random.integers(-3, 3, (count, 4))
    rows = np.concatenate([mixes, bits, ordinary.view(np.uint64)])
    rows[:, 2:] &= np.uint64(2**63 - 1)
    w, tau, most, move = (np.ascontiguousarray(c).view(np.float64) for c in rows.T)
    near = random.random(len(w)) < 0.5  # half of them: the torque before at the limit's own scale
    with np.errstate(all="ignore"):
        tau = np.where(near, np.copysign(most, tau) * random.choice([0.0, 0.5, 1.0], len(w)), tau)
    keep = np.isfinite(most) & (most > 0) & np.isfinite(move) & np.isfinite(tau) & (np.abs(tau) <= most)
    return {"wanted": w[keep], "last": tau[keep], "limit": most[keep], "step": move[keep]}


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Library:
    return Library(tmp_path_factory.mktemp("guard"), 2)


def c_limit(library: Library, columns: dict[str, np.ndarray]) -> np.ndarray:
    """hda_limit over columns."""
    out = np.empty_like(columns["wanted"])
    arrays = [np.ascontiguousarray(columns[k]) for k in ("wanted", "last", "limit", "step")] + [out]
    library.c.harness_limit(ct.c_int64(len(out)), *(x.ctypes.data_as(ct.c_void_p) for x in arrays))
    return out


def test_the_proved_expression_is_the_c_bit_by_bit(library: Library) -> None:
    columns = hostile_columns(200_000, seed=1)
    assert len(columns["wanted"]) >= 200_000
    assert not np.isfinite(columns["wanted"]).all()
    proved = np.broadcast_to(evaluate(limiter(), columns), columns["wanted"].shape)
    computed = c_limit(library, columns)
    assert np.array_equal(proved.view(np.uint64), computed.view(np.uint64))
    assert not np.array_equal(evaluate(rate_before_size(), columns), computed), "the comparison cannot fail"


def test_the_bit_test_is_the_c_bit_by_bit(library: Library) -> None:
    x = np.concatenate([hostile_columns(100_000, seed=2)["wanted"], EDGES.view(np.float64)])
    out = np.empty(len(x), dtype=np.int32)
    library.c.harness_finite(ct.c_int64(len(x)), x.ctypes.data_as(ct.c_void_p), out.ctypes.data_as(ct.c_void_p))
    assert np.array_equal(out == 1, evaluate(finite_bits(wanted_bits), {"wanted": x}))
    assert np.array_equal(out == 1, np.isfinite(x))


def test_the_step_exceeds_the_rate_by_rounding_alone(library: Library) -> None:
    """|out - last| <= step + half a unit in the last place of last ± step, in exact arithmetic."""
    columns = hostile_columns(2_000, seed=3)
    pick = np.random.default_rng(4).permutation(len(columns["wanted"]))[:20_000]
    columns = {k: v[pick] for k, v in columns.items()}
    exceeded = 0
    for out, before, move in zip(c_limit(library, columns), columns["last"], columns["step"], strict=True):
        moved, allowed = abs(Fraction(out) - Fraction(before)), Fraction(move)
        edge = min(abs(float(before)) + float(move), np.finfo(float).max)  # Python's floats overflow in silence
        assert moved <= allowed + Fraction(math.ulp(edge)) / 2
        exceeded += moved > allowed
    assert exceeded > 0, "the rounding never showed: the bound was not tested"


def test_the_length_is_right_without_libm(library: Library) -> None:
    random = np.random.default_rng(5)
    pairs = random.normal(size=(20_000, 2)) * 10.0 ** random.integers(-150, 150, (20_000, 2))
    for x, y in [*pairs.tolist(), (0.0, -0.0), (3.0, -4.0), (1e308, 1e308), (5e-324, 0.0), (1e-310, 1e-310)]:
        true = math.hypot(x, y)
        assert abs(library.c.hda_length(x, y) - true) <= 2 * math.ulp(true)
    assert not math.isfinite(library.c.hda_length(math.inf, 1.0))
    assert math.isnan(library.c.hda_length(math.nan, 1.0)) or math.isnan(library.c.hda_length(1.0, math.nan))
