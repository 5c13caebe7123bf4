# %% [markdown]
# # What will the office look like at one, and at three?
#
# `chronotope.Grid` keeps when each cell of an occupancy grid changed, learns the rhythm of the changes, and predicts the map of
# any time. The office is made up: on working days cupboards along its corridor stand open, two doors, too, and chairs move. So
# cells have rhythms of a day and of a week: `base="week"`, the five strongest of each cell.

# %%
import datetime

import matplotlib.pyplot as plt
import numpy as np

import chronotope

MONDAY = datetime.datetime(2024, 5, 6, tzinfo=datetime.timezone.utc)
office = chronotope.Office(seed=1, resolution=0.05)
times = [MONDAY + datetime.timedelta(hours=n) for n in range(0, 21 * 24, 2)]
grid = office.grid()
grid.observe_many([office.render(time) for time in times], times)
grid.set_model(base="week", order=5)
grid

# %% [markdown]
# ## Four hours of a day that was not seen
#
# The part between the two rooms: a corridor between cupboards, and above it a way with a door at either end. Above what is
# predicted, grey where the grid is not sure; below what is there, two days after the last map. Row 0 of an array has the lowest
# y, so `origin="lower"`.

# %%
hours = (3, 7, 13, 19)
day = MONDAY + datetime.timedelta(days=22)
middle = np.s_[:, 130:325]
figure, axes = plt.subplots(2, 4, figsize=(12, 7.4), dpi=80, layout="constrained")
for column, hour in enumerate(hours):
    time = day + datetime.timedelta(hours=hour)
    predicted, truth = grid.predict(time), office.render(time)
    for axis, cells in ((axes[0, column], predicted), (axes[1, column], np.where(truth < 0, np.nan, truth / 100))):
        axis.set_facecolor("#cbd5e1")
        axis.imshow(cells[middle], origin="lower", cmap="gray_r", vmin=0, vmax=1)
        axis.set_xticks([])
        axis.set_yticks([])
    axes[0, column].set_title(f"{time:%A %H:%M}", fontsize=10)
axes[0, 0].set_ylabel("predicted")
axes[1, 0].set_ylabel("true")
plt.show()

# %% [markdown]
# ## Why?
#
# The amplitude of each cell's strongest rhythm, and one cell of a cupboard.

# %%
period_s, amplitude = grid.rhythms()
figure, axis = plt.subplots(figsize=(6, 3.2), dpi=80)
image = axis.imshow(np.where(np.isnan(amplitude), 0, amplitude), origin="lower", cmap="viridis")
figure.colorbar(image, label="amplitude")
axis.set_xticks([])
axis.set_yticks([])
plt.tight_layout()
row, column = np.unravel_index(np.nanargmax(amplitude), grid.shape)
explained = grid.explain(grid.center((int(row), int(column))), day + datetime.timedelta(hours=13))
explained.to_dict()

# %% [markdown]
# ## Which way will be free?
#
# From door to door: at one o'clock straight through, at night, when the doors are shut, round by the corridor.

# %%
figure, axes = plt.subplots(1, 2, figsize=(11, 3.2), dpi=80)
for axis, hour in zip(axes, (3, 13)):
    time = day + datetime.timedelta(hours=hour)
    axis.imshow(grid.predict(time), origin="lower", cmap="gray_r", vmin=0, vmax=1)
    path = grid.plan((6.0, 9.6), (18.0, 9.6), time)
    if path is not None:
        cells = np.array([grid.cell(tuple(point)) for point in path.xy])
        axis.plot(cells[:, 1], cells[:, 0], color="#16a34a", linewidth=2)
        axis.set_title(f"{time:%H:%M}: {path.length_m:.1f} m, free with p = {path.p_free:.2f}", fontsize=10)
    axis.set_xticks([])
    axis.set_yticks([])
plt.tight_layout()

# %% [markdown]
# ## Maps that are not believed
#
# In a file each new map is judged. Of two patrols the second one was mapped upside down.

# %%
import pathlib
import tempfile

folder = tempfile.TemporaryDirectory()
with grid.save(pathlib.Path(folder.name) / "office.grid") as kept:
    later = day + datetime.timedelta(hours=9)
    verdicts = [kept.add(office.render(later), later, observer="robot")]
    later += datetime.timedelta(hours=1)
    verdicts.append(kept.add(office.render(later)[::-1], later, observer="robot"))
    waiting = len(kept.held())
for verdict in verdicts:
    print(verdict.outcome, verdict.why)
print(waiting, "waits in quarantine")
