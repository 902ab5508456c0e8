"""The calibration of the 4-DOF head with the machine as its reference stage: a regression over all
nine channels.

The machine moves the target sideways by known amounts (jogs) at two or more distances, and stands
still while the laser's pointing changes. In one lateral axis (theory.md 9), ``m`` is the jog of the
target, ``X`` is the lateral offset of the target at this end of the travel, ``a`` is the pointing
of the source, and ``L = l + d`` is the lever:

    spot on the QD   q = 2 (m + X) - 2 L a         times 1 + growth (d - middle)
    PSD1               = -a + leak1 q
    PSD2               = a (1 + 2 leak2 L) + a constant of the end

The readings of each detector also depend on its two gains, its two signs and its roll. The pointing
is an unknown of every row, is linear in the model, and is eliminated (variable projection: Golub,
Pereyra 1973; Kaufman's approximation), so noise of a detector does not reduce the estimated slopes.
The noise of each detector is the noise of its samples times a common factor. The common factor and
the errors of the jogs are estimated from the residuals. Separate factors for three detectors are
not possible, because the smallest noise would become zero.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.errors import DataError
from stepdiag.base.messages import Message, message

Vector = NDArray[np.float64]

FIELDS = (
    "qd.x",
    "qd.y",
    "qd.rotation_mrad",
    "crosstalk.qd_gain_per_m",
    "psd1.x",
    "psd1.y",
    "psd1.rotation_mrad",
    "crosstalk.psd1_leak",
    "psd2.x",
    "psd2.y",
    "psd2.rotation_mrad",
    "crosstalk.psd2_leak",
    "lever",
)
"""Names of the results, as the fields of the calibration file: gains relative to the curves in
the file, rolls in mrad, increase of the QD's gain per metre, leaks in urad per um (equal in x
and y), the dead path of the lever in mm."""
QD, PSD1, PSD2, LEVER = 0, 4, 8, 12
"""Index in `FIELDS` of each detector's first gain and of the lever."""
MOST_ROLL_MRAD = 500.0
"""Largest possible roll of a mounted detector; a larger value means that the detector's axes in
the survey file are wrong."""
MOST_U_GAIN = 0.02
"""Largest relative standard uncertainty of a gain; a larger value means that the change of
pointing or the jogs were too small."""
ROUNDS, STEPS = 6, 8
"""Number of iterations of the noise, and number of Gauss-Newton steps in each iteration. Half of
these numbers is already enough for 1e-6."""
LINEAR = 1e-3
"""Smallest noise of a detector relative to the change of pointing: the relative error of a
detector's curve."""
JOG_UM = 1.0
"""Initial value of the estimated error of a jog, in um of the spot on the detector."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stands:
    """Means of the head's samples while the machine stood, one row each (N,).

    ``end`` is the number of the axial position, from 0. ``distance_mm`` is the distance to the
    target. ``moved_um`` (N, 2) is the jog in the directions of the detectors' x and y. ``seen`` (N,
    6) are the readings of QD (um), PSD1 and PSD2 (urad) by the curves of the file, without signs
    and rolls. ``samples`` is the number of samples in each row; ``noise`` (6,) is the noise of one
    sample. ``jogged`` marks the rows after a jog.
    """

    end: NDArray[np.intp]
    distance_mm: Vector
    moved_um: Vector
    seen: Vector
    samples: Vector
    noise: Vector
    jogged: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class Commissioned:
    """Values and covariance of `FIELDS`, and the standard deviation of the difference between a
    real and a commanded jog, in um of the target (k = 1)."""

    value: Vector
    covariance: Vector
    middle_mm: float
    u_jog_um: float

    @property
    def u(self) -> Vector:
        """Return the standard uncertainty of each field."""
        u: Vector = np.sqrt(np.diag(self.covariance))
        return u


def commissioned(stands: Stands) -> Commissioned:
    """Return the calibration by the run. Raises DataError, with the name of the field, if the
    run does not determine a field."""
    _require_places(stands)
    middle_mm = float(np.mean(np.unique(stands.distance_mm)))
    factor, jog_um = 1.0, JOG_UM
    parameters = _start(stands)
    for _ in range(ROUNDS):
        sigma = _sigma(stands, factor, jog_um)
        for _ in range(STEPS):
            step, rest, leverage = _gauss_newton(stands, parameters, middle_mm, sigma)
            parameters = parameters + step.value
        of_jogs = _of_jogs(stands)
        factor = max(1.0, factor * _grown(rest, leverage, ~of_jogs))
        jog_um = jog_um * _grown(rest, leverage, of_jogs)
    found = Commissioned(
        value=parameters[: len(FIELDS)],
        covariance=step.covariance[: len(FIELDS), : len(FIELDS)],
        middle_mm=middle_mm,
        u_jog_um=jog_um * float(np.mean(np.abs(parameters[QD : QD + 2]))) / 2.0,
    )
    _require_decided(found, stands)
    return found


def _model(stands: Stands, parameters: Vector, pointing: Vector, middle_mm: float) -> Vector:
    ends = parameters[len(FIELDS) :].reshape(2, -1, 2)
    lever = (parameters[LEVER] + stands.distance_mm)[:, None]
    leak1, leak2 = parameters[PSD1 + 3], parameters[PSD2 + 3]
    spot = 2.0 * (stands.moved_um + ends[0][stands.end]) - 2e-3 * lever * pointing
    growth = 1.0 + parameters[QD + 3] * 1e-3 * (stands.distance_mm - middle_mm)[:, None]
    seen = (
        spot * growth,
        leak1 * spot - pointing,
        pointing * (1.0 + 2e-3 * leak2 * lever) + ends[1][stands.end],
    )
    return np.hstack(
        [
            _detector_reading(parameters[first : first + 3], one)
            for first, one in zip((QD, PSD1, PSD2), seen, strict=True)
        ]
    )


def _detector_reading(detector: Vector, lateral: Vector) -> Vector:
    """Return the readings of a detector with two gains and a roll in mrad: the inverse of
    `detector.spots`."""
    cosine, sine = np.cos(1e-3 * detector[2]), np.sin(1e-3 * detector[2])
    own: Vector = lateral @ np.array([[cosine, -sine], [sine, cosine]]) / detector[:2]
    return own


@dataclass(frozen=True, slots=True)
class _Step:
    value: Vector
    covariance: Vector


def _gauss_newton(
    stands: Stands, parameters: Vector, middle_mm: float, sigma: Vector
) -> tuple[_Step, Vector, Vector]:
    """Return the next step of the parameters, the weighted residuals without the pointing, and
    the leverage of each residual, both (N, 6)."""
    still = np.zeros_like(stands.moved_um)
    base = _model(stands, parameters, still, middle_mm)
    by_pointing = np.stack(
        [
            (_model(stands, parameters, still + unit, middle_mm) - base) / sigma
            for unit in np.eye(2)
        ],
        axis=2,
    )
    frame, _ = np.linalg.qr(by_pointing)
    pointing = np.einsum(
        "nij,nj->ni", np.linalg.pinv(by_pointing), (stands.seen - base) / sigma
    )
    here = _model(stands, parameters, pointing, middle_mm)
    columns = []
    for index, value in enumerate(parameters):
        moved = parameters.copy()
        moved[index] += (size := 1e-6 * max(1.0, abs(value)))
        columns.append(
            _without(
                frame, (_model(stands, moved, pointing, middle_mm) - here) / (size * sigma)
            ).ravel()
        )
    rest = _without(frame, (stands.seen - here) / sigma)
    jacobian = np.column_stack(columns)
    scale = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-30)
    left, singular, right = np.linalg.svd(jacobian / scale, full_matrices=False)
    kept = np.maximum(singular, 1e-12 * singular[0])
    value = (right.T @ ((left.T @ rest.ravel()) / kept)) / scale
    covariance = (right.T / kept**2) @ right / np.outer(scale, scale)
    leverage = np.sum(frame**2, axis=2) + np.sum(left**2, axis=1).reshape(rest.shape)
    return _Step(value, covariance), rest, leverage


def _without(frame: Vector, rows: Vector) -> Vector:
    """Return rows (N, 6) without the part that any pointing can cause."""
    left: Vector = rows - np.einsum("nij,nj->ni", frame, np.einsum("nij,ni->nj", frame, rows))
    return left


def _of_jogs(stands: Stands) -> NDArray[np.bool_]:
    of_jogs = np.zeros(stands.seen.shape, dtype=np.bool_)
    of_jogs[stands.jogged, :2] = True
    return of_jogs


def _sigma(stands: Stands, factor: float, jog_um: float) -> Vector:
    """Return the standard deviation of every value, shape (N, 6). A longer standstill reduces
    the noise, but not the error of a jog."""
    still = ~stands.jogged
    wobble = np.std(_centred(stands, stands.seen, still)[still], axis=0)
    sigma: Vector = factor * np.hypot(
        stands.noise / np.sqrt(stands.samples)[:, None], LINEAR * wobble
    )
    return np.where(_of_jogs(stands), np.hypot(sigma, jog_um), sigma)


def _grown(rest: Vector, leverage: Vector, of: NDArray[np.bool_]) -> float:
    return float(
        np.sqrt(max(np.sum(rest[of] ** 2) / max(np.sum(1.0 - leverage[of]), 1.0), 1e-6))
    )


def _require_places(stands: Stands) -> None:
    ends = np.unique(stands.end)
    jogs = [
        (
            stands.distance_mm[stands.end == end][0],
            np.ptp(stands.moved_um[stands.end == end], axis=0).min(),
        )
        for end in ends
    ]
    distances = {distance for distance, moved_um in jogs if moved_um > 0.0}
    if len(distances) < 2:
        found = message("commission-places", count=len(distances))
        raise DataError(
            "commission",
            expected=message("jogs-at-two-distances"),
            found=found,
            remedy=message("fourdof-commission-program"),
        )


def _start(stands: Stands) -> Vector:
    ends = int(stands.end.max()) + 1
    about = stands.jogged[:, None] * _centred(stands, stands.moved_um, stands.jogged)
    qd = _of_matrix(
        _matrix(
            2.0 * about,
            _centred(stands, stands.seen[:, :2], stands.jogged) * stands.jogged[:, None],
        ),
        "qd",
    )
    spot = _lateral(qd, stands.seen[:, :2])
    still = ~stands.jogged
    pointing = (
        -_centred(stands, spot, still) / (2e-3 * stands.distance_mm[:, None]) * still[:, None]
    )
    psd1, psd2 = (
        _of_matrix(
            _matrix(
                sign * pointing,
                _centred(stands, stands.seen[:, first : first + 2], still) * still[:, None],
            ),
            name,
        )
        for sign, first, name in ((-1.0, 2, "psd1"), (1.0, 4, "psd2"))
    )
    offsets = np.array([[spot[stands.end == end].mean(axis=0) / 2.0 for end in range(ends)]])
    rest = np.concatenate([offsets, np.zeros_like(offsets)]).ravel()
    return np.concatenate([qd, [0.0], psd1, [0.0], psd2, [0.0], [0.0], rest])


def _centred(stands: Stands, values: Vector, used: NDArray[np.bool_]) -> Vector:
    count = np.maximum(np.bincount(stands.end, weights=used), 1.0)
    means = [np.bincount(stands.end, weights=used * column) / count for column in values.T]
    centred: Vector = values - np.array(means).T[stands.end]
    return centred


def _matrix(lateral: Vector, read: Vector) -> Vector:
    matrix: Vector = np.asarray(
        np.linalg.lstsq(lateral, read, rcond=None)[0].T, dtype=np.float64
    )
    return matrix


def _of_matrix(matrix: Vector, name: str) -> Vector:
    sizes = np.linalg.norm(matrix, axis=1)
    if not np.isfinite(sizes).all() or sizes.min() <= 0.0:
        raise DataError(
            f"commission: {name}",
            expected=message("motion-on-detector"),
            found=message("none"),
            remedy=message("wobble-more"),
        )
    of_x, of_y = (
        np.arctan(matrix[0, 1] / matrix[0, 0]),
        np.arctan(-matrix[1, 0] / matrix[1, 1]),
    )
    if not max(abs(of_x), abs(of_y)) < 1e-3 * MOST_ROLL_MRAD:
        found = message("roll-found", mrad=float(1e3 * of_x), other_mrad=float(1e3 * of_y))
        remedy = message("detector-axes-or-wobble")
        raise DataError(
            f"commission: {name}",
            expected=message("roll-within", mrad=MOST_ROLL_MRAD),
            found=found,
            remedy=remedy,
        )
    return np.array([*(np.sign(np.diag(matrix)) / sizes), 500.0 * (of_x + of_y)])


def _lateral(detector: Vector, read: Vector) -> Vector:
    cosine, sine = np.cos(1e-3 * detector[2]), np.sin(1e-3 * detector[2])
    lateral: Vector = (read * detector[:2]) @ np.array([[cosine, sine], [-sine, cosine]])
    return lateral


def _require_decided(found: Commissioned, stands: Stands) -> None:
    nearest = float(found.value[LEVER] + stands.distance_mm.min())
    if not nearest > 0.0:
        expected, seen = (
            message("lever-above-none"),
            message(
                "lever-found", lever_mm=nearest, distance_mm=float(stands.distance_mm.min())
            ),
        )
        raise DataError(
            "commission: lever",
            expected=expected,
            found=seen,
            remedy=message("beam-direction-or-distance"),
        )
    for index in (QD, QD + 1, PSD1, PSD1 + 1, PSD2, PSD2 + 1):
        share = float(found.u[index] / abs(found.value[index]))
        if not share <= MOST_U_GAIN:
            expected, seen = (
                message("gain-known-within", percent=100 * MOST_U_GAIN),
                message("gain-known", percent=100 * share),
            )
            raise DataError(
                f"commission: {FIELDS[index]}",
                expected=expected,
                found=seen,
                remedy=_more(index),
            )


def _more(index: int) -> Message:
    return message("jog-more") if index < PSD1 else message("wobble-more")
