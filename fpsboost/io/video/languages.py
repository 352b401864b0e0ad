"""Languages by the three letters that containers want."""

from __future__ import annotations

import re

_pairs = """
aaaar ababk aeave afafr akaka amamh anarg arara asasm avava ayaym azaze babak bebel bgbul bhbih bibis bmbam bnben
bobod brbre bsbos cacat ceche chcha cocos crcre csces cuchu cvchv cycym dadan dedeu dvdiv dzdzo eeewe elell eneng
eoepo esspa etest eueus fafas ffful fifin fjfij fofao frfra fyfry gagle gdgla glglg gngrn guguj gvglv hahau heheb
hihin hohmo hrhrv hthat huhun hyhye hzher iaina idind ieile igibo iiiii ikipk ioido isisl itita iuiku jajpn jvjav
kakat kgkon kikik kjkua kkkaz klkal kmkhm knkan kokor krkau kskas kukur kvkom kwcor kykir lalat lbltz lglug lilim
lnlin lolao ltlit lulub lvlav mgmlg mhmah mimri mkmkd mlmal mnmon mrmar msmsa mtmlt mymya nanau nbnob ndnde nenep
ngndo nlnld nnnno nonor nrnbl nvnav nynya ococi ojoji omorm orori ososs papan pipli plpol pspus ptpor quque rmroh
rnrun roron rurus rwkin sasan scsrd sdsnd sesme sgsag sisin skslk slslv smsmo snsna sosom sqsqi srsrp ssssw stsot
susun svswe swswa tatam tetel tgtgk ththa titir tktuk tltgl tntsn toton trtur tstso tttat twtwi tytah uguig ukukr
ururd uzuzb veven vivie vovol wawln wowol xhxho yiyid yoyor zazha zhzho zuzul
"""
"""ISO 639-1 and ISO 639-2/T of each language that has both: two letters, and three."""

three_letters = {pair[:2]: pair[2:] for pair in _pairs.split()}
"""ISO 639-2/T by ISO 639-1."""


_bibliographic = (
    *("sqialb", "hyearm", "eusbaq", "myabur", "zhochi", "cescze", "nlddut", "frafre", "katgeo", "deuger", "ellgre"),
    *("islice", "mkdmac", "mrimao", "msamay", "fasper", "ronrum", "slkslo", "bodtib", "cymwel"),
)
"""ISO 639-2/T and ISO 639-2/B of the languages in which these differ."""

other_spelling = {pair[:3]: pair[3:] for pair in _bibliographic} | {pair[3:]: pair[:3] for pair in _bibliographic}
"""The other three letters of a language that has two spellings."""


def spellings(language: str) -> list[str]:
    """A language by its three letters, whatever stands behind it (``es-419``), most usual first; none if unknown.

    Examples
    --------
    >>> spellings("es"), spellings("pt-BR"), spellings("GER"), spellings("Spanish")
    (['spa'], ['por'], ['ger', 'deu'], [])
    """
    name = re.split(r"[-_]", language.strip().lower(), maxsplit=1)[0]
    letters = name if re.fullmatch(r"[a-z]{3}", name) else three_letters.get(name)
    if letters is None:
        return []
    return [letters, other_spelling[letters]] if letters in other_spelling else [letters]
