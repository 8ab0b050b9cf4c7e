# %% [markdown]
# # Read a verdict
#
# `hdagen diagnose` writes a verdict into diagnosis.json. This page reads one with all its doubts. It is of a real
# machine: the simple pendulum of the DFKI underactuated lab, whose robot file states no friction.

# %%
from importlib.resources import as_file, files

import hdagen

with as_file(files("hdagen.data") / "pendulum_diagnosis.json") as stored:
    diagnosis = hdagen.read_diagnosis(stored)

# %% [markdown]
# ## The verdict in words
#
# The sentence names the effect and its probability, and says whether the verdict is sure. In a notebook,
# `diagnosis` alone shows the first screen of the report.

# %%
print(diagnosis.sentence)
print(diagnosis.verdict, "sure" if diagnosis.sure else "not sure")

# %% [markdown]
# ## The gap
#
# The gap is the error of a replay on motion that the fit did not see, in multiples of the noise: 1 is a model as
# good as the sensors. `achievable` is the least gap of everything that was fitted. Where `after` lies well above
# it, something is missing still.

# %%
gap = diagnosis.gap
print(f"before {gap['before']:.3g}, after {gap['after']:.3g}, achievable {gap['achievable']:.3g}")
for channel, error in gap["by_channel"].items():
    print(f"{channel}: {error['before']:.3g} to {error['after']:.3g} times its noise of {error['noise']:.2g}")

# %% [markdown]
# ## The hypotheses and their doubts
#
# One row a set of effects, the most probable first. Read the columns of doubts from left to right:
#
# - `unknown`: the set names something that no effect of the list explains.
# - `unconfirmed`: held-out motion did not confirm the set.
# - `confounded_with`: other effects explain this log nearly as well.
# - `not_needed`: the gap is as small without these effects.
# - `not_shown`: this motion would not show these effects in their usual size.
# - `at_end`: these parameters stand at the end of their range.

# %%
table = diagnosis.table()
print(table)
named = next(row for row in table if row["verdict"])
print("the verdict may also be:", named["confounded_with"] or "nothing else", "or", table["hypothesis"][0])

# %% [markdown]
# The table goes into Arrow, pandas or polars: `pyarrow.table(table)`, `table.to_pandas()`,
# `polars.DataFrame(table)`.
#
# ## What would settle the doubt
#
# Each cause has the motion that separates it from those it is confounded with. `hdagen.excite` designs such a
# motion.

# %%
for cause in diagnosis.content["causes"]:
    if f"{cause['effect']}@{cause['joint']}" in diagnosis.verdict:
        print(cause["separate_by"])

# %% [markdown]
# ## The parameters
#
# Those of the named effects come first, then the base parameters within their tolerance.

# %%
print(diagnosis.parameters())

# %% [markdown]
# ## Where and when
#
# The place of the effect, its share of the closed gap, and the motion in which it shows.

# %%
for place in diagnosis.content["where"]:
    print(f"joint {place['joint']}, {place['place']}: {place['when']}")
for moment in diagnosis.content["moments"]:
    begin, end = moment["span"]
    print(f"once only: {begin:.2f} to {end:.2f} s of {moment['log']}")
