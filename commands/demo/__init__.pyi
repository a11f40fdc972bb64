from .run import claim_folder as claim_folder
from .run import run_demo as run_demo
