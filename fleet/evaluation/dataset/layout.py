"""Layout: what a data set's folder holds, and what its columns mean.

`steps.parquet` has a row for each agent and step, and one more for what an agent saw last:

| column | |
|---|---|
| `episode`, `step` | number of the episode, and of the step within it |
| `agent`, `type` | name of the agent, and what stands before its number |
| `observation` | numbers that the agent saw before it acted |
| `mask` | which actions were legal, 1 or 0; null without masks |
| `action` | what it did: a whole number, or a list of numbers; null in an agent's last row |
| `reward` | what it earned by that; null in an agent's last row |
| `info_NAME` | what `infos` said, terms of the reward among it; null in an agent's last row, and if not told |
| `terminated`, `truncated` | whether the agent's episode ended with this step |

`dataset.json` has scenario, environment with version, arguments, policy, seeds, figures by episode, commit, versions.
"""

STEPS, ABOUT = "steps.parquet", "dataset.json"
"""Files of a data set."""
FORMAT = 1
"""Of both."""
INFO = "info_"
"""What columns of `infos` begin with."""
