"""Three-letter language codes (ISO 639-2), as containers store them."""

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
"""ISO 639-1 and ISO 639-2/T codes of each language that has both: two letters followed by three."""

three_letters = {pair[:2]: pair[2:] for pair in _pairs.split()}
"""ISO 639-2/T code by ISO 639-1 code."""


_bibliographic = (
    *("sqialb", "hyearm", "eusbaq", "myabur", "zhochi", "cescze", "nlddut", "frafre", "katgeo", "deuger", "ellgre"),
    *("islice", "mkdmac", "mrimao", "msamay", "fasper", "ronrum", "slkslo", "bodtib", "cymwel"),
)
"""ISO 639-2/T and ISO 639-2/B codes of the languages for which these differ."""

other_spelling = {pair[:3]: pair[3:] for pair in _bibliographic} | {pair[3:]: pair[:3] for pair in _bibliographic}
"""The other three-letter code of a language that has two."""


def spellings(language: str) -> list[str]:
    """Return the three-letter codes of a language tag, first the one given or its ISO 639-2/T code.

    A suffix (``es-419``) is ignored. The list is empty if the language is unknown.

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
