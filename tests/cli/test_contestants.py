"""Who takes part in a comparison: methods with options, by text."""

import pytest

from fpsboost import OptionError, VectorFolder, find_method, methods
from fpsboost.cli.compare import choose, name_others, split_methods
from fpsboost.evaluation.compared_methods import Minterpolate, method_names
from support.truth import SCENES, needs_scenes


@pytest.mark.parametrize(
    ("texts", "found"),
    [
        (["nlm,dis"], ["nlm", "dis"]),
        (["nlm", "dis,blend"], ["nlm", "dis", "blend"]),
        (["nlm:v=0.1,dis"], ["nlm:v=0.1", "dis"]),
        ([" nlm:v=0.1 , patch-radius=4 ,dis"], ["nlm:v=0.1,patch-radius=4", "dis"]),
        (["nlm:v=0.1,nlm:v=0.2"], ["nlm:v=0.1", "nlm:v=0.2"]),
    ],
)
def test_commas_part_methods_and_options(texts, found):
    """What has an equals sign is an option of the method before, anything else is a method."""
    assert split_methods(texts) == found


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("v=0.1,nlm", "'v=0.1' follows no method name; write METHOD:v=0.1"),
        ("nlm,v=0.1", "'v=0.1' follows no method name"),
        ("nlm,,dis", "lacks a name"),
        ("nlm:", "has an option without a value"),
        ("nlm:v", "has an option without a value"),
        ("nlm:v=", "has an option without a value"),
        ("nlm:v=1,v=2", "gives v twice"),
        ("magic:v=1", "There is no method 'magic'; choose one of nlm"),
        ("nml:v=1", "There is no method 'nml'; did you mean 'nlm'"),
        ("nlm:window=box", "The method 'nlm' has no option 'window'; it has .*patch-radius"),
        ("blend:v=1", "The method 'blend' has no option 'v'; it has none"),
        ("nlm:others=dis", "has no option 'others'"),
        ("nlm:search-radius=7", "The method 'nlm' has no option 'search-radius'"),
        ("dis:cuts=None", "The method 'dis' has no option 'cuts'"),
        ("block:pattern=spiral", "`pattern` must be one of full, three-step, diamond, not 'spiral'"),
        ("nlm-exhaustive:iterations=0", "`iterations` must be"),
        ("nlm:v=nan", "In nlm:v=nan: `v` must be a number, not 'nan'"),
        ("nlm:patch-radius=2.5", "`patch_radius` must be a whole number, not 2.5"),
        ("nlm:patch-radius=14", "In nlm:patch-radius=14: `patch_radius` must be 1 to 10 pixels"),
        ("nlm-exhaustive:window=hat", "`window` must be one of box, gaussian, not 'hat'"),
        ("nlm:vectors=maybe", "`nlm:vectors` must be one of yes, no, not 'maybe'"),
        ("minterpolate:fps=9", "minterpolate takes no fps=9"),
        ("minterpolate:mi_mode=dup:scd=none", "minterpolate takes no mi_mode=dup:scd=none"),
    ],
)
def test_what_is_no_method_is_one_sentence(text, sentence):
    """It names the option, and says what there is."""
    with pytest.raises(OptionError, match=sentence):
        choose([text], None)


@pytest.mark.parametrize("name", methods)
def test_every_default_can_be_written_as_an_option(name):
    """What a method has is read back from its text as it is."""
    parts = methods[name].estimator, methods[name].synthesizer
    fields = {field: value for part in reversed(parts) for field, value in vars(part).items()}
    texts = {field.replace("_", "-"): str(value) for field, value in fields.items() if type(value) in (int, float, str)}
    assert find_method(":".join(filter(None, [name, ",".join(map("=".join, texts.items()))]))) == methods[name]


def test_all_stands_for_every_method_beside_others():
    """Also beside one with options; those that need vectors are named with the reason."""
    compared_methods, skipped = choose(["all", "dis:preset=fast"], None)
    assert {*compared_methods, *skipped} == {*method_names(), "dis:preset=fast"}
    assert {"reproject-image", "reproject-scene"} <= set(skipped)


def test_the_filter_takes_its_own_options():
    """FFmpeg's names, also with dashes, over the defaults."""
    assert Minterpolate.with_options({"me-mode": "bilat", "mb_size": "8"}).options == (
        "mi_mode=mci:mc_mode=aobmc:me_mode=bilat:vsbmc=1:scd=none:mb_size=8"
    )


@pytest.mark.parametrize(
    ("frames", "peers", "sentence"),
    [
        (["x"], [], "--frames 'x' lacks a name"),
        (["=x"], [], "--frames '=x' lacks a name"),
        ([], ["x="], "--peer 'x=' lacks a name"),
        (["nlm=x"], [], "'nlm' is the name of another method"),
        (["a=x"], ["a=cp {in} {out}"], "'a' is the name of another method"),
        ([], ["a=cp {in}"], "The command of the peer a lacks {out}"),
        ([], ["a=cp '{in} {out}"], "cannot be read"),
    ],
)
def test_other_tools_need_names_and_folders(frames, peers, sentence):
    """A sentence says which, before anything is read."""
    with pytest.raises(OptionError, match=sentence):
        name_others(frames, peers)


def test_the_command_compares_one_method_with_several_options(fpsboost_, tmp_path, save_images):
    """Each under the name that was given; options may stand behind several ``-m``."""
    save_images(tmp_path / "clip")
    result = fpsboost_("compare", "clip", "-m", "dis:preset=fast,dis,blend", "-m", "dis:preset=ultrafast")
    assert result.code == 0, result.err
    for word in ("preset=fast", "preset=ultrafast", "│ dis ", "│ blend "):
        assert word in result.out


@needs_scenes
def test_vectors_go_to_all_that_take_them():
    """The report's search chooses its radius by them, as in a conversion; the default method never sees them."""
    folder = VectorFolder(SCENES / "glass" / "vectors")
    compared_methods, skipped = choose(["nlm-exhaustive:v=0.1,nlm,reproject-image"], folder)
    assert skipped == {}
    searching, default, reprojecting = (
        compared_method.interpolator.estimator for compared_method in compared_methods.values()
    )
    assert (searching.vectors, searching.v) == (folder, 0.1)
    assert reprojecting.vectors is folder
    assert not hasattr(default, "vectors")


def test_a_metric_says_which_numbers_are_better():
    """Between its name and the command, which may hold anything."""
    texts = ["a:lower=x {truth} {made}", " b:higher = y=':' {truth} {made} "]
    tools = name_others((), (), texts)
    assert [(tool.name, tool.better, tool.value, tool.text) for tool in tools] == [
        ("a", ":lower", "x {truth} {made}", texts[0]),
        ("b", ":higher", "y=':' {truth} {made}", texts[1]),
    ]


@pytest.mark.parametrize(
    ("texts", "sentence"),
    [
        (["a=x {truth} {made}"], "'a=x {truth} {made}' lacks a name or another part; write --metric NAME:lower="),
        (["a:best=x"], "lacks a name or another part"),
        ([":lower=x"], "lacks a name or another part"),
        (["a:lower="], "lacks a name or another part"),
        (["a:lower=x", "a:higher=y"], "'a' is the name of another"),
    ],
)
def test_a_metric_that_says_too_little_is_one_sentence(texts, sentence):
    """It shows how to write one."""
    with pytest.raises(OptionError, match=sentence):
        name_others((), (), texts)
