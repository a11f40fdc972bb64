"""A bench: simulated cards, what their inputs read, their wires and their failures, in a file.

`haploop twin ni --bench bench.toml -- COMMAND` runs a program on one.
"""

from .file import Bench as Bench
from .file import read_bench as read_bench
from .running import Running as Running
from .running import running as running
