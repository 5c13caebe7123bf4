# %% [markdown]
# # A year of a street, and the next one
#
# A rendered street of four places is learnt over 2023: twelve rounds at all hours, in all seasons. Then
# images of 2024 are localised. The street is drawn by the package itself, so this notebook needs no data.

# %%
import os
import tempfile

import matplotlib.pyplot as plt
import numpy as np

import chronotope

street = chronotope.Street(seed=1, num_places=4)
learn, query = street.schedule(num_learn=12, num_query=6)
print(f"{len(learn)} rounds to learn, from {learn[0]:%d %B %Y} to {learn[-1]:%d %B %Y}")

# %% [markdown]
# One place at four times of the year. Blossom, lamps, shutters, shadows and parked cars follow year, week and
# day.

# %%
times = ["2023-01-15T08:00:00Z", "2023-05-10T15:00:00Z", "2023-07-12T11:00:00Z", "2023-11-20T21:00:00Z"]
figure, axes = plt.subplots(1, 4, figsize=(12, 3), dpi=80)
for axis, time in zip(axes, times):
    axis.imshow(street.render(street.places[1], time), cmap="gray", vmin=0, vmax=255)
    axis.set_title(time[:16].replace("T", " "), fontsize=9)
    axis.axis("off")
plt.tight_layout()

# %% [markdown]
# ## Learn
#
# `write_street` makes the folder that anybody's own images would be in: pictures, and an `index.csv` with the
# columns place, time, path. `Map.build` learns it.

# %%
os.chdir(tempfile.mkdtemp())
chronotope.write_street(street, "images", learn)
street_map = chronotope.Map.build("images", "street.map")
street_map

# %%
for place in street_map.places:
    print(place)

# %% [markdown]
# ## Localise
#
# A grey image is a numpy array of uint8; a time is an aware datetime. An answer shows itself: what was found is
# green, what was predicted and is missing orange, what nobody predicted grey; beside it the posterior.

# %%
localizer = chronotope.Localizer(street_map)
place, time = street.places[1], query[2]
answer = localizer.localize(street.render(place, time), time, name=f"in truth {place}")
answer

# %% [markdown]
# Everything behind an answer is an array.

# %%
print(answer.decision, answer.place, answer.displacement_px)
answer.matches[:3]

# %% [markdown]
# All of 2024 on two threads, against the map without time. To make it hard, only ten features of each place
# are matched.

# %%
images, when, truth = [], [], []
for start in query:
    for place in street.places:
        images.append(street.render(place, start))
        when.append(start)
        truth.append(place)

figure, axis = plt.subplots(figsize=(7, 3), dpi=80)
for method in ("fremen", "static"):
    hard = chronotope.Localizer(street_map, method=method, n=10, config={"many-visits": 1})
    answers = hard.localize_many(images, when, threads=2)
    right = np.array([it.places[0] == true for it, true in zip(answers, truth)])
    sure = np.array([it.ranking[0].posterior for it in answers])
    axis.plot(np.sort(sure)[::-1], marker=".", label=f"{method}: {right.sum()} of {len(right)} first places right")
axis.set_xlabel("query, the surest first")
axis.set_ylabel("posterior of the first place")
axis.set_ylim(0, 1.02)
axis.legend()
plt.tight_layout()

# %% [markdown]
# ## A place that the map lacks
#
# A place that was never learnt should not be recognised. "Unknown" is an answer and no error.

# %%
elsewhere = chronotope.Street(seed=77, num_places=1)
localizer.localize(elsewhere.render(elsewhere.places[0], query[0]), query[0], name="another street")
