"""A bench with the instruments beside its cards (`nidaqmx_twin.bench`), and on a tape.

`haploop twin ni --bench bench.toml -- COMMAND` runs a program on one.
"""

from .running import Running as Running
from .running import running as running
