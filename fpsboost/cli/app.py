"""Command line: parses arguments, builds objects, calls the library, shows progress and chooses the exit code."""

from __future__ import annotations

import gc
import os
import re
import sys
from collections.abc import Sequence
from difflib import get_close_matches
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, CoercionError, CycloptsError, Group, MissingArgumentError, Parameter, UnusedCliTokensError
from cyclopts.exceptions import UnknownOptionError
from rich.console import Console
from rich.table import Table

from fpsboost import __version__
from fpsboost.cli import stop_signals
from fpsboost.cli.errors import PIPE, all_explained, standard_output_finished
from fpsboost.cli.flags import GROUPS, MAIN, OWN_OPTIONS, Cuts, Further, Input, Reading, default_text, with_flags
from fpsboost.cli.library_texts import LibraryTexts, library_texts, native_stderr_captured
from fpsboost.cli.messages import (
    as_objects,
    console,
    keep_columns_readable,
    literal,
    print_object,
    reporter_of,
    say_error,
    say_traceback,
    sentence,
)
from fpsboost.cli.options import (
    JoinOptions,
    MessageOptions,
    MethodOptions,
    PathName,
    TrialOptions,
    TuningOptions,
)
from fpsboost.cli.stopping import stopping_on
from fpsboost.cluster import ClusterOptions
from fpsboost.errors import CompleteAlreadyError, FpsboostError, OptionError, ReaderGoneError, notes_of
from fpsboost.io.video.encode_options import Encoding
from fpsboost.memory import address_space, limit_free_memory
from fpsboost.remarks import Remarks
from fpsboost.run_options import RunOptions
from fpsboost.timing.options import Timing

EXAMPLES = """
[bold]Examples[/]
  fpsboost in.mp4                                      twice: in-2x.mp4
  fpsboost in.mp4 out.mp4 --dry-run                    time and size
  fpsboost in.mp4 out.mkv --fps 59.94 --crf 16         a rate, not a factor
  fpsboost renders/ doubled/                           a folder of images
  fpsboost renders/ --fill-gaps --in-place             the missing images
  fpsboost in.mp4 out.mp4 --replace 120-123,340        damaged frames
  fpsboost in.mp4 out.mp4 --duplicates drop            the true rate
  fpsboost in.mp4 out.mp4 --gaps auto                  dropped frames
  fpsboost a.png b.png between/ --factor 8             two pictures
  fpsboost shot_####.png out.mp4 --input-fps 24        images to video
  fpsboost in.mp4 out.mp4 --start 1:30 --end 2:00      a part of it
  fpsboost in.mp4 out.mp4 --factor 4 --slow-motion     four times as long
  fpsboost in.mp4 out.mp4 --speed 0.25@1:00-1:05       slower for 5 seconds
  fpsboost in.gif out.webp                             gif, apng or webp
  fpsboost in.mp4 frames/ --method nlm-exhaustive      another method
  fpsboost a.mp4 b.mov renders/ out/                   several, into a folder
  fpsboost in.mp4 out.mp4 --resume                     continue a stopped run
  fpsboost in.mp4 out.mp4 --cluster tls://host:8786    on many machines
  fpsboost in.mp4 out.mp4 --chunk 3/8                  one part of eight
  fpsboost join out.mp4 out.mp4.parts/                 the eight parts joined
  ffmpeg -i in -f yuv4mpegpipe - | fpsboost - out.mp4  from a pipe
  fpsboost probe in.mp4                                properties of a clip
  fpsboost preview in.mp4                              before and after
  fpsboost plan renders/ plan/ --budget 10%            regions to render
  fpsboost merge doubled/ regions/ out/ --plan plan/   regions into frames
  fpsboost compare in.mp4 --report page/               methods scored
"""

SHORT_EXAMPLES = """
[bold]Examples[/]
  fpsboost in.mp4                                      twice: in-2x.mp4
  fpsboost in.mp4 --fps 60                             a rate, not a factor
  fpsboost in.mp4 --factor 4 --slow-motion             four times as long
  fpsboost in.mp4 --speed 0.25@1:00-1:05               slower for 5 seconds
  fpsboost in.mp4 out.mp4 --codec hevc --crf 26        a small file
  fpsboost renders/ --in-place                         the missing images
  fpsboost preview in.mp4                              before and after

fpsboost --help lists all options, fpsboost COMMAND --help those of a command."""

Shell = Literal["bash", "zsh", "fish"]

SPLIT_AT_SPACES = 'COMPREPLY=( $(compgen -f -- "${cur}") )'
"""Line of Cyclopts' script for bash that completes names of files, and splits those with spaces."""

ZSH_ENTRY = """
_fpsboost() { _cyclopts_fpsboost "$@" || _files }
if [[ "$zsh_eval_context[-1]" == loadautofunc ]]; then
  _fpsboost "$@"
else
  compdef _fpsboost fpsboost
fi
"""
"""Call of the function of Cyclopts' script for zsh: at the first TAB of a file of ``$fpath``, or once it is sourced."""

app = App(
    name="fpsboost",
    help="Raise the frame rate of a video or an image sequence.",
    usage="Usage: fpsboost [OPTIONS] IN [OUT]\n       fpsboost [OPTIONS] IN... FOLDER\n       fpsboost COMMAND",
    help_epilogue=EXAMPLES.strip(),
    help_format="rich",
    help_flags=("--help",),
    suppress_keyboard_interrupt=False,
    version=f"fpsboost {__version__}",
    group_commands=Group("Commands", sort_key=len(GROUPS) + 1),
    default_parameter=Parameter(negative=(), show_default=default_text, show_choices=False),
)


@app.default
@with_flags
def convert(
    input: Input,
    output: Annotated[PathName | None, Parameter(name="OUT")] = None,
    /,
    *more: Further,
    decoding: Reading,
    timing: Annotated[Timing, GROUPS["Rate"]],
    motion: Annotated[MethodOptions, GROUPS["Method"]],
    cuts: Cuts,
    encoding: Annotated[Encoding, GROUPS["Encoding"]],
    run_options: Annotated[RunOptions, GROUPS["Run"]],
    where: Annotated[ClusterOptions, GROUPS["Run"]],
    messages: Annotated[MessageOptions, GROUPS["Run"]],
    trial: Annotated[TrialOptions, GROUPS["Run"]],
    tuning: Annotated[TuningOptions, GROUPS["Method options"]],
) -> None:
    """Raise the frame rate of a video or an image sequence.

    Parameters
    ----------
    input
        A video, an animation (gif, apng, webp), a folder of images,
        shot_%04d.png, shot_####.png, or - for a YUV4MPEG2 pipe.
    output
        The same; video as mp4, m4v, mov, mkv or webm, and a
        folder with a slash at its end. Else beside IN: in-2x.mp4.
        With several inputs a folder, created if missing.
    more
        Further names; the last one is the folder.
    """
    gc.disable()  # until the first frame is read: importing makes many objects and few cycles
    # imported here so that --help and --version need not wait for OpenCV and FFmpeg
    from fpsboost.cli.batch import Conversions  # noqa: PLC0415

    interpolator = cuts.applied_to(motion.interpolator(tuning))
    check_is_no_command(input)
    conversions = Conversions(
        timing, interpolator, motion.method, decoding, encoding, run_options, where, messages, trial.dry_run
    )
    conversions.convert([input, *([] if output is None else [output]), *more])


def check_is_no_command(input: str) -> None:
    """Raise `OptionError` if an input that does not exist is spelled almost like a command."""
    if Path(input).suffix or os.path.exists(input):
        return
    names = {name.strip("-"): name for name in app}
    for meant in get_close_matches(input.lower(), names, 1):
        raise OptionError(f"{input} is neither a command nor a file; did you mean fpsboost {names[meant]}?")


app.command(
    "fpsboost.cli.probe:probe", help="Print the properties of a clip, and what a conversion keeps.", help_epilogue=""
)
app.command(
    "fpsboost.cli.preview:preview",
    help="Show passages before and after, and estimate the time.",
    usage="Usage: fpsboost preview [OPTIONS] IN [PAGE]",
    help_epilogue="",
)
app.command(
    "fpsboost.cli.compare:compare",
    help="Hide frames, interpolate them and score each method.",
    usage="Usage: fpsboost compare [OPTIONS] IN...",
    help_epilogue="Exit codes: 0 compared, 1 failed, 2 wrong usage or no method to compare, 3 below --fail-under.",
)
app.command("fpsboost.cli.plan:plan", help="Find regions of interpolated frames to render instead.", help_epilogue="")
app.command("fpsboost.cli.plan:merge", help="Put rendered regions into interpolated frames.", help_epilogue="")


@app.command(name="join", usage="Usage: fpsboost join [OPTIONS] OUT PART...", help_epilogue="")
@with_flags
def join(
    output: Annotated[PathName, Parameter(name="OUT")],
    part: Annotated[PathName, Parameter(name="PART")],
    /,
    *more: Further,
    options: Annotated[JoinOptions, OWN_OPTIONS],
    messages: Annotated[MessageOptions, OWN_OPTIONS],
) -> None:
    """Join the parts of a conversion.

    Parameters
    ----------
    output
        A video or folder of the type that the parts were made for.
    part
        The folders of all parts, in any order,
        or the folder that holds them: OUT.parts.
    more
        Further parts.
    """
    from fpsboost.parts.join import join as join_parts  # noqa: PLC0415

    with native_stderr_captured(), reporter_of(output, messages) as reporter:
        summary = join_parts(output, [part, *more], input=options.input, overwrite=options.overwrite, observer=reporter)
    reporter.say_summary(summary)


app.command(
    "fpsboost.ui.command:ui",
    help="Convert clips on a page in the browser.",
    usage="Usage: fpsboost ui [OPTIONS] [FOLDER]",
    help_epilogue="",
)
app.command("fpsboost.cli.doctor:doctor", help="Check whether fpsboost works on this machine.", help_epilogue="")


@app.command(
    help_epilogue="bash: source <(fpsboost completion bash), in ~/.bashrc\n"
    "zsh: fpsboost completion zsh > ~/.zfunc/_fpsboost, with fpath+=~/.zfunc in ~/.zshrc\n"
    "fish: fpsboost completion fish > ~/.config/fish/completions/fpsboost.fish",
)
def completion(shell: Annotated[Shell, Parameter(name="SHELL")], /) -> None:
    """Print the completion script of a shell.

    Parameters
    ----------
    shell
        bash, zsh or fish.
    """
    script = app.generate_completion(shell=shell)
    if shell == "bash":
        # where nothing is proposed, bash itself completes names of files, as it does everywhere else
        script = script.replace(SPLIT_AT_SPACES, "COMPREPLY=()").replace("\ncomplete -F ", "\ncomplete -o default -F ")
    print(script + ZSH_ENTRY if shell == "zsh" else script)


def print_short_help() -> None:
    """Print the main options, the commands and a few examples to standard output."""
    table = Table.grid(padding=(0, 2))
    for argument in app.assemble_argument_collection().filter_by(group=GROUPS[MAIN]):
        given = argument.parameter
        table.add_row("", " ".join(filter(None, [*argument.names, given.metavar])), literal(given.help or ""))
    commands = ", ".join(name for name in app if not name.startswith("-"))
    parts = app.usage, f"\n{app.help}\n\n[bold]{MAIN}[/]", table, f"\n[bold]Commands[/]\n  {commands}", SHORT_EXAMPLES
    Console(highlight=False).print(*parts, sep="\n")


def check_dashes(tokens: Sequence[str]) -> None:
    """Raise `OptionError` for a long option with one dash, which the parser takes for short ones: ``-fps`` for -f ps.

    The same for a longer dash, which word processors make of two.
    """
    for token, following in pairwise([*tokens, ""]):
        found = re.fullmatch("[-\N{HYPHEN}-\N{HORIZONTAL BAR}\N{MINUS SIGN}]([a-z][a-z-]+)(=.*)?", token)
        if found is None:
            continue
        command = app.parse_commands(tokens)[1][-1]
        arguments = {name: each for each in command.assemble_argument_collection() for name in each.names}
        for meant in get_close_matches(f"--{found[1]}", arguments, 1, 0.8):
            value = found[2] or ("" if arguments[meant].hint is bool or following[:1] == "-" else f" {following}")
            raise OptionError(f"{token} is not an option; write {meant}{value.rstrip()}, with two dashes.")


def main() -> None:
    """Run the command line and exit; called by `fpsboost.__main__`."""
    gc.freeze()  # objects of modules imported so far stay alive
    gc.enable()
    limit_free_memory()  # before there is a second thread
    keep_columns_readable()
    with stopping_on(*stop_signals()), library_texts() as texts:
        run_command(texts)


def execute(tokens: Sequence[str]) -> None:
    """Run the command given by the words of the command line, or print its help; errors pass to the caller."""
    check_dashes(tokens)
    if tokens[0] in app:
        tokens = ["--help" if token == "-h" else token for token in tokens]
        if tokens[0] != "join":  # the others have no details to print but tracebacks
            tokens = [token for token in tokens if token != "--verbose"]
    if "-h" in tokens:
        print_short_help()
    else:
        app(tokens, exit_on_error=False, print_error=False, result_action="return_value")


def run_command(texts: LibraryTexts) -> None:
    """Run the command line; exit with a code above 0 unless it succeeds.

    Codes: 1 for a failure, 2 for wrong usage, 130 after a request to stop. `texts` are those of libraries, which are
    printed at the end.
    """
    errors = console()
    tokens = [PIPE if token == "-" else token for token in sys.argv[1:]] or ["-h"]
    quiet = {"--quiet", "-q"} & set(tokens)
    in_json = "--progress=json" in tokens or ("--progress", "json") in pairwise(tokens)
    verbose = "--verbose" in tokens
    try:
        with all_explained([token for token in tokens if token not in app]), standard_output_finished():
            address_space()  # raises an error if too little, which libraries do not report when they are loaded
            execute(tokens)
        if texts.sentence() and in_json:
            print_object(remarks=as_objects(Remarks([texts.sentence()])))
        elif texts.sentence() and not quiet:
            errors.print(f"Note: {literal(texts.sentence())}")
    except KeyboardInterrupt as stopped:
        left = notes_of(stopped)
        nothing = "Stopped." if PIPE in tokens else "Stopped; nothing was written."
        errors.print(f"Stopped; {sentence(left)}" if left else nothing)
        sys.exit(130)
    except ReaderGoneError:  # without a message, like other filters
        sys.exit(1)
    except CompleteAlreadyError as error:  # not a failure, so that a batch can be started again
        if not quiet:
            errors.print(sentence(str(error)))
    except CycloptsError as error:
        command = " ".join(["fpsboost", *(error.command_chain or ())])
        errors.print(f"[red]fpsboost:[/] {literal(_usage_sentence(error, command))} See {command} --help.")
        sys.exit(2)
    except FpsboostError as error:
        if verbose and not isinstance(error.__cause__, MemoryError):
            say_traceback()
            for line in texts.lines():
                errors.print(literal(line))
        say_error(errors, error)
        sys.exit(2 if isinstance(error, OptionError) else 1)


def _usage_sentence(error: CycloptsError, command: str) -> str:
    """Return a parser's error as one sentence."""
    if isinstance(error, UnusedCliTokensError):
        return f"{command} does not take {' '.join(error.unused_tokens or ())}."
    if isinstance(error, UnknownOptionError):
        flag = error.token.keyword or error.token.value.partition("=")[0]
        if flag in ("--help", "--version"):
            return f"{flag} takes no value; write it alone."
        if command != "fpsboost" and any(flag in argument.names for argument in app.assemble_argument_collection()):
            return f"{command} does not take {flag}, an option of conversions."
    name = getattr(error.argument, "name", "-")
    if isinstance(error, CoercionError) and error.token is not None and error.target_type in (int, float):
        number = "a whole number" if error.target_type is int else "a number"
        return f"{name} must be {number}, not {error.token.value!r}."
    if not isinstance(error, MissingArgumentError):
        return str(error)
    lacks = f"{name} needs a value; write one that begins with a dash as {name}=-1."
    return lacks if name.startswith("-") else f"{name} is missing."
