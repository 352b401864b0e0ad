"""Public names, by the modules that they are loaded from at first use; see `lazy_loader` and SPEC 1."""

from .clip import Clip as Clip
from .clip import Reading as Reading
from .clip import TimedPicture as TimedPicture
from .clip import open as open
from .facts import Facts as Facts
from .facts import Look as Look
from .facts import StreamFacts as StreamFacts
from .facts import inspect as inspect
from .facts import list_streams as list_streams
from .facts import look_of as look_of
from .info import ClipInfo as ClipInfo
from .info import EncodeSettings as EncodeSettings
from .info import OutputTiming as OutputTiming
from .output import Output as Output
from .output import StreamInfo as StreamInfo
from .traits import VideoTraits as VideoTraits
from .writer import FileWriter as FileWriter
from .writer import PartWriter as PartWriter
from .writer import Writer as Writer
from .writer import create as create
