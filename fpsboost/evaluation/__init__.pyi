"""Names of a comparison that the command line uses, by the modules that they are loaded from at first use."""

from .contestants import MINTERPOLATE as MINTERPOLATE
from .contestants import Contestant as Contestant
from .contestants import InterpolatorContestant as InterpolatorContestant
from .contestants import Minterpolate as Minterpolate
from .contestants import method_names as method_names
from .export import Row as Row
from .export import area_rows as area_rows
from .export import further_rows as further_rows
from .export import mean_rows as mean_rows
from .export import overall_rows as overall_rows
from .export import write_csv as write_csv
from .export import write_json as write_json
from .further_metrics import choose_metrics as choose_metrics
from .further_metrics import metrics as metrics
from .hidden_frames import Hiding as Hiding
from .hidden_frames import Interval as Interval
from .hidden_frames import parse_range as parse_range
from .peers import find_frames as find_frames
from .peers import run_peer as run_peer
from .peers import split_command as split_command
from .report.styles import break_name as break_name
from .results import ComparedClip as ComparedClip
from .results import Comparison as Comparison
from .verdict import judge as judge
from .verdict import judge_all as judge_all
from .verdict import means_over_clips as means_over_clips
