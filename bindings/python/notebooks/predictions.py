# %% [markdown]
# # What a place will look like, and what follows from that
#
# For each feature of a place the map has learnt when it can be seen. This notebook looks at predicted maps, at
# the rhythms behind them, and at how the risk that is allowed changes decisions.

# %%
import os
import tempfile

import matplotlib.pyplot as plt
import numpy as np

import chronotope

street = chronotope.Street(seed=1, num_places=4)
learn, query = street.schedule(num_learn=24, num_query=8)
os.chdir(tempfile.mkdtemp())
chronotope.write_street(street, "images", learn)
street_map = chronotope.Map.build("images", "street.map")
place = street_map[street.places[1]]
place

# %% [markdown]
# ## The log of a place
#
# One row a visit, one column a feature: seen (green), not seen (white), or not observable (grey) because it
# was born later. This log is the truth; every model is a cache of it.

# %%
seen = place.seen()
colours = np.array([[0.8, 0.8, 0.8], [1, 1, 1], [0.09, 0.64, 0.29]])
figure, axis = plt.subplots(figsize=(10, 3), dpi=80)
axis.imshow(colours[seen + 1], aspect="auto", interpolation="nearest")
axis.set_xlabel(f"{seen.shape[1]} features of {place.name}, in order of birth")
axis.set_ylabel("visit")
plt.tight_layout()

# %% [markdown]
# ## One place at four hours
#
# The fifty features chosen for each hour, over the image that is really there. Size and opacity are p(t).

# %%
times = ["2024-01-15T08:00:00Z", "2024-05-10T15:00:00Z", "2024-07-12T11:00:00Z", "2024-11-20T21:00:00Z"]
predicted = street_map.predict_many(place.name, times, n=50)
figure, axes = plt.subplots(1, 4, figsize=(12, 3), dpi=80)
for axis, time, one in zip(axes, times, predicted):
    axis.imshow(street.render(place.name, time), cmap="gray", vmin=0, vmax=255)
    axis.scatter(one.xy[:, 0], one.xy[:, 1], s=30 * one.p, c="#16a34a", alpha=0.25 + 0.75 * one.p.clip(0, 1))
    axis.set_title(f"{time[:16].replace('T', ' ')}, mean p {one.p.mean():.2f}", fontsize=9)
    axis.axis("off")
plt.tight_layout()

# %%
common = len(set(predicted[1].ids.tolist()) & set(predicted[3].ids.tolist()))
print(f"a May afternoon and a November night share {common} of 50 features")
predicted[3]

# %% [markdown]
# ## How sure is a prediction?
#
# p(t) of three changeable features over five days, each with its 95 % interval: where nobody has looked,
# the interval is wide. Features that are seen and missed together have one curve, so those shown differ.

# %%
hours = np.arange(0, 5 * 24, 2)
week = np.datetime64("2024-05-06T00:00", "s") + hours * np.timedelta64(3600, "s")
curves = street_map.predict_many(place.name, list(week), n=len(place))
p = np.zeros((len(curves), len(place), 3))
for row, one in enumerate(curves):
    p[row, one.ids] = one.estimate
changeable = []
for feature in np.argsort(p[:, :, 0].std(axis=0))[::-1]:
    if all(np.abs(p[:, feature, 0] - p[:, other, 0]).mean() > 0.15 for other in changeable):
        changeable.append(feature)
    if len(changeable) == 3:
        break
figure, axis = plt.subplots(figsize=(10, 3), dpi=80)
for feature in changeable:
    x, y = place.xy[feature]
    (line,) = axis.plot(hours / 24, p[:, feature, 0], label=f"feature {feature} at ({x:.0f}, {y:.0f})")
    axis.fill_between(hours / 24, p[:, feature, 1], p[:, feature, 2], alpha=0.15, color=line.get_color())
axis.set_xlabel("days from Monday")
axis.set_ylabel("p(t)")
axis.set_ylim(-0.02, 1.02)
axis.legend(fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, frameon=False)
plt.tight_layout()

# %% [markdown]
# ## Decisions looked at
#
# An answer names a place only if the probability of being wrong is at most the risk that is allowed. The same
# queries at three risks: what is answered, and how much of that is wrong. Images are half masked, so that it
# is not too easy.

# %%
mask = np.ones((384, 448), bool)
mask[:, 150:] = False
queries = [(street.render(name, start), start, name) for start in query for name in street.places]
rows = []
for risk in (0.01, 0.05, 0.25):
    localizer = chronotope.Localizer(street_map, risk=risk)
    answers = [localizer.localize(image, time, mask=mask) for image, time, _ in queries]
    at = [(answer, true) for answer, (_, _, true) in zip(answers, queries) if answer.decision == "at"]
    wrong = sum(answer.place != true for answer, true in at)
    rows.append((risk, len(at), wrong, len(queries) - len(at)))
    print(f"risk {risk:4}: {len(at)} of {len(queries)} located, {wrong} of them wrong, {len(queries) - len(at)} left open")

# %%
figure, axis = plt.subplots(figsize=(7, 2.4), dpi=80)
labels = [f"{risk:.0%}" for risk, *_ in rows]
located = np.array([right - wrong for _, right, wrong, _ in rows])
wrong = np.array([wrong for _, _, wrong, _ in rows])
left = np.array([left for *_, left in rows])
axis.barh(labels, located, color="#16a34a", label="located, right")
axis.barh(labels, wrong, left=located, color="#dc2626", label="located, wrong")
axis.barh(labels, left, left=located + wrong, color="#94a3b8", label="ambiguous or unknown")
axis.set_xlabel("queries")
axis.set_ylabel("risk that is allowed")
axis.legend(fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, frameon=False)
plt.tight_layout()

# %% [markdown]
# The least sure of them, as it is: half of the image is not used.

# %%
least = min(answers, key=lambda it: it.ranking[0].posterior)
least
