# %% [markdown]
# # When will the door be open?
#
# Any 0/1 series is learnt by `chronotope.series` in scikit-learn's manner. This notebook learns a door and, with
# data, compares FreMEn with what a Python user would pick: seasonal means by hand, a harmonic regression by
# `statsmodels`, and scikit-learn's histogram gradient boosting on features of the time.
#
# Real data is read from the folder that the environment variable `CHRONOTOPE_DATA` names (`series/door`,
# `series/door2016`, `series/aruba`); without it a made-up office door stands in.

# %%
import gzip
import os

# On a busy machine the threads of scikit-learn's booster wait for each other; one is quicker.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import pathlib
import time
import warnings

import matplotlib.pyplot as plt
import numpy as np

from chronotope import Fremen, series

warnings.simplefilter("ignore")
data = os.environ.get("CHRONOTOPE_DATA")
folder = pathlib.Path(data) / "series" if data else None
rng = np.random.default_rng(1)


def made_up(first_day, num_days, every_s=60):
    """An office door: open in working hours of working days, more or less; one state a minute."""
    times = np.arange(first_day * 86_400, (first_day + num_days) * 86_400, every_s)
    hour, weekday = times % 86_400 / 3_600, (times // 86_400 + 3) % 7
    p = np.where((hour > 8) & (hour < 17) & (weekday < 5), 0.8, 0.03)
    # It stays open or shut for a while.
    slots = times // 1_800
    draw = np.random.default_rng(first_day).random(slots.max() - slots.min() + 1)
    return times, draw[slots - slots.min()] < p


def read(name):
    """Times in seconds since 1970 and states of a packed CSV file."""
    rows = np.genfromtxt(gzip.open(folder / name), delimiter=",", skip_header=1)
    return rows[:, 0].astype(np.int64), rows[:, 1] > 0.5


def door2016():
    if folder is None:
        return made_up(16_804, 70), made_up(16_874, 7)
    return read("door2016/learn_10_weeks.csv.gz"), read("door2016/test_week_1.csv.gz")


(learn_t, learn_s), (test_t, test_s) = door2016()
print(f"{len(learn_t)} minutes to learn, open in {100 * learn_s.mean():.1f} % of them; {len(test_t)} to predict")

# %% [markdown]
# ## Learn a door
#
# Learnt from 2 % of the minutes, drawn at random: a robot passes now and then.

# %%
few = rng.choice(len(learn_t), len(learn_t) // 50, replace=False)
door = Fremen().fit(learn_t[few], learn_s[few])
for period_s, amplitude, phase in door.components_[:5]:
    print(f"every {period_s / 3_600:6.1f} h, by {amplitude:.2f}")

# %%
figure, axis = plt.subplots(figsize=(10, 3), dpi=80)
some = slice(0, None, 10)
hours = (test_t[some] - test_t[0]) / 86_400
p, low, high = door.estimate(test_t[some]).T
axis.fill_between(hours, test_s[some].astype(float), step="mid", alpha=0.25, color="grey", label="open")
axis.plot(hours, p, color="#16a34a", label="p(t)")
axis.fill_between(hours, low, high, alpha=0.2, color="#16a34a", label="95 % interval")
axis.set_xlabel("days of a week that was not learnt")
axis.set_ylim(-0.02, 1.02)
axis.legend(fontsize=8, loc="upper right")
plt.tight_layout()

# %%
lines = door.periodogram()
figure, axis = plt.subplots(figsize=(10, 2.6), dpi=80)
axis.vlines(lines[:, 0] / 3_600, 0, lines[:, 1], color="#16a34a", label="states")
axis.plot(lines[:, 0] / 3_600, lines[:, 2], ".", color="#ea580c", markersize=3, label="sampling alone")
axis.set_xscale("log")
axis.set_xlabel("period, h")
axis.set_ylabel("amplitude")
axis.legend(fontsize=8)
plt.tight_layout()

# %%
surprises = door.anomalies(test_t, test_s, confidence=0.95)
print(f"{len(surprises)} minutes of the week that were given less than 5 %")
for row in surprises[:: max(len(surprises) // 4, 1)][:4]:
    print("  ", np.datetime64(int(test_t[row]), "s"), "open" if test_s[row] else "shut")

# %% [markdown]
# ## What a Python user would pick
#
# Each learns from the same samples and predicts p(t) for the same times. None is tuned on the test weeks: the
# seasonal mean takes hours of the week, smoothed by one pseudo-count; the harmonic regression is
# least squares on six harmonics of a day and six of a week; the booster has hour of day, day of week, hour of week and
# day of year as features, with scikit-learn's defaults.

# %%
import statsmodels.api as sm
from sklearn.ensemble import HistGradientBoostingClassifier


class SeasonalMean:
    """The share of ones in each hour of the week."""

    def fit(self, times, states):
        slot = times // 3_600 % 168
        ones = np.bincount(slot, states, 168) + states.mean()
        self.p_ = ones / (np.bincount(slot, minlength=168) + 1)
        return self

    def p(self, times):
        return self.p_[times // 3_600 % 168]


class HarmonicRegression:
    """Least squares on harmonics of day and week, by statsmodels; predictions are cut to [0, 1]."""

    def _features(self, times):
        columns = [np.ones(len(times))]
        for base, count in ((86_400, 6), (604_800, 6)):
            for k in range(1, count + 1):
                angle = 2 * np.pi * k * (times % base) / base
                columns += [np.cos(angle), np.sin(angle)]
        return np.stack(columns, axis=1)

    def fit(self, times, states):
        self.result_ = sm.OLS(states.astype(float), self._features(times)).fit()
        return self

    def p(self, times):
        return self.result_.predict(self._features(times)).clip(0, 1)


class Boosting:
    """Histogram gradient boosting on features of the time, by scikit-learn."""

    def _features(self, times):
        hour, day = times % 86_400 / 3_600, times // 86_400
        return np.stack([hour, (day + 3) % 7, times % 604_800 / 3_600, day % 365.2425], axis=1)

    def fit(self, times, states):
        self.model_ = HistGradientBoostingClassifier(random_state=0).fit(self._features(times), states)
        return self

    def p(self, times):
        return self.model_.predict_proba(self._features(times))[:, 1]


RIVALS = {
    "FreMEn": Fremen,
    "seasonal mean": SeasonalMean,
    "harmonics": HarmonicRegression,
    "boosting": Boosting,
    "mean": series.Mean,
}


def by_day(times, errors):
    """Sum of errors and number of samples of each day: days, not minutes, are independent."""
    day = (times - times[0]) // 86_400
    return np.bincount(day, errors), np.bincount(day)


def interval(days, draws=2_000):
    """Mean with its 95 % interval, bootstrapped over days."""
    total, count = days
    rows = np.random.default_rng(2).integers(0, len(total), (draws, len(total)))
    means = total[rows].sum(axis=1) / count[rows].sum(axis=1)
    return total.sum() / count.sum(), *np.percentile(means, [2.5, 97.5])


def compare(name, sets, share, num_draws=5):
    """Brier scores of all rivals, over several series and five draws of the samples; and their times."""
    num_samples = int(len(sets[0][0]) * share)
    print(f"\n{name}, {share:.1%} of the samples ({num_samples} a series), {num_draws} draws")
    scores = {}
    for rival, make in RIVALS.items():
        totals, fit_s, predict_s = [], 0.0, 0.0
        for draw in range(num_draws):
            for times, states, later, truth in sets:
                rows = np.random.default_rng(draw).choice(len(times), num_samples, replace=False)
                times, states = times[rows], states[rows]
                if states.min() == states.max():
                    p, begun = np.full(len(later), float(states[0])), time.perf_counter()
                else:
                    begun = time.perf_counter()
                    model = make().fit(times, states)
                    fit_s += time.perf_counter() - begun
                    begun = time.perf_counter()
                    p = model.p(later)
                    predict_s += time.perf_counter() - begun
                totals.append(by_day(later, (p - truth) ** 2))
        days = tuple(np.sum(part, axis=0) for part in zip(*totals))
        scores[rival] = days
        brier, low, high = interval(days)
        num = num_draws * len(sets)
        print(f"  {rival:14} Brier {brier:.4f} [{low:.4f}, {high:.4f}]   fit {1e3 * fit_s / num:7.1f} ms, predict {1e3 * predict_s / num:6.1f} ms")
    # Paired, day by day: the difference to FreMEn.
    for rival in list(RIVALS)[1:]:
        (a, n), (b, _) = scores[rival], scores["FreMEn"]
        difference, low, high = interval((a - b, n))
        verdict = "worse" if low > 0 else "better" if high < 0 else "not told apart"
        print(f"  {rival:14} minus FreMEn: {difference:+.4f} [{low:+.4f}, {high:+.4f}], {verdict}")
    return {rival: interval(days) for rival, days in scores.items()}


door_sets = [(learn_t, learn_s, test_t, test_s)]
results = {
    "door, 0.2 %": compare("door", door_sets, 0.002),
    "door, 2 %": compare("door", door_sets, 0.02),
}

# %% [markdown]
# ### A person in nine rooms
#
# Aruba: twelve weeks of minutes to learn, four to predict; one state a room. Without data, two made-up doors.


# %%
def aruba():
    if folder is None:
        learnt, later = made_up(100, 84), made_up(184, 28)
        return [(*learnt, *later)] * 2
    rooms = np.loadtxt(folder / "aruba" / "location.min", dtype=int)
    # A Monday begins the file; its ids count from 1.
    times = 4 * 86_400 + 60 * np.arange(len(rooms))
    cut = 12 * 7 * 24 * 60
    ids = [room for room in np.unique(rooms) if (rooms[:cut] == room).any()]
    return [(times[:cut], rooms[:cut] == room, times[cut:], rooms[cut:] == room) for room in ids]


aruba_sets = aruba()
results["Aruba, 0.2 %"] = compare("Aruba", aruba_sets, 0.002)
results["Aruba, 2 %"] = compare("Aruba", aruba_sets, 0.02)

# %%
figure, axes = plt.subplots(1, len(results), figsize=(12, 2.8), dpi=80)
for axis, (name, rows) in zip(axes, results.items()):
    for at, (rival, (brier, low, high)) in enumerate(rows.items()):
        colour = "#16a34a" if rival == "FreMEn" else "#475569"
        axis.errorbar(brier, -at, xerr=[[brier - low], [high - brier]], fmt="o", color=colour, capsize=3)
    axis.set_yticks(-np.arange(len(rows)), list(rows) if axis is axes[0] else [""] * len(rows))
    axis.set_title(name, fontsize=10)
    axis.set_xlabel("Brier score, less is better", fontsize=8)
plt.tight_layout()

# %% [markdown]
# Days are drawn again for the intervals, because minutes of one day are not independent; differences are
# paired day by day.
