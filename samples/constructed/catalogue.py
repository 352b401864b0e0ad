"""The clips by name."""

from __future__ import annotations

from functools import partial

from . import depth, fluids, glass, objects, patterns, surfaces
from .layers import Clip

clips: dict[str, Clip] = {
    # patterns that repeat
    "bars": Clip(patterns.make_bars, "bars of period 6 fill the frame, 4.2", noise=1, blur=0.5),
    "tiles": Clip(patterns.make_tiles, "tiles of period 40 fill the frame, turn 10°"),
    "bricks": Clip(patterns.make_bricks, "bricks of 40x12 in perspective, 17, yaw 3°", noise=1),
    "windows": Clip(patterns.make_windows, "windows of period 40x20 in perspective, 26", blur=0.6),
    "fence": Clip(patterns.make_fence, "slats of period 20, 7; garden behind -4", noise=1.5),
    "railing": Clip(patterns.make_railing, "short railing of period 12, 15, turn 2°; street behind 3", blur=0.5),
    "grille": Clip(patterns.make_grille, "grille of period 20, zoom 8 %; room behind 2 %"),
    "keyboard": Clip(patterns.make_keyboard, "keys of period 20 in perspective, 13, turn 3°; desk 3", noise=1),
    "dots": Clip(patterns.make_dots, "dotted cloth of period 6, up to 8, turn 4°; behind -6", blur=0.5),
    # things that move by themselves
    "balls": Clip(objects.make_balls, "plain balls of 7 to 26, 1 to 4 diameters; still behind"),
    "balls-pan": Clip(
        objects.make_balls_pan, "plain balls of 9 to 32 on curves, 1 to 4 diameters; behind -9", noise=1.5, blur=0.5
    ),
    "turning": Clip(objects.make_turning, "cut-outs turn 10 to 20°", noise=1),
    "growing": Clip(objects.make_growing, "cut-outs zoom -15 to 20 %; behind -2", blur=0.6),
    "cans": Clip(objects.make_cans, "printed cylinders spin 8 to 20°"),
    "crowd": Clip(objects.make_crowd, "46 people walk, 3 to 16, limbs swing", noise=1),
    "flock": Clip(objects.make_flock, "70 birds wheel and flap, 2 to 40; sky 1.5", blur=0.5),
    # what changes while it moves
    "fire": Clip(fluids.make_fire, "flames rise, 14 to 34", noise=1),
    "water": Clip(partial(fluids.make_water, steepness=0.045, speed=2.5), "calm waves bend the ground below"),
    "rapids": Clip(
        partial(fluids.make_water, steepness=0.1, speed=7), "steep fast waves over the ground", noise=1, blur=0.6
    ),
    "smoke": Clip(partial(fluids.make_smoke, wind=8, density=0.75), "thin smoke, 8; behind -3", noise=1),
    "smoke-thick": Clip(partial(fluids.make_smoke, wind=20, density=0.95), "thick smoke, 20; behind -3"),
    # layers at different distances
    "posts": Clip(depth.make_posts, "three layers, 6, 15 and 44", noise=1),
    "trees-blurred": Clip(depth.make_trees, "three layers with motion blur, 9, 20 and 56", subframes=9),
    "doorway": Clip(depth.make_doorway, "leaves zoom 12 % in front of a zoom of 3 %", blur=0.5),
    "hair": Clip(depth.make_hair, "hairs of 1 and 2 swing; behind 7", supersampling=4, noise=1),
    "crane": Clip(depth.make_crane, "lattices of 1.25 turn 3 to 5°, wires of 1 and 2; behind -7", supersampling=4),
    "rods": Clip(partial(depth.make_rods, leaves=6, grain=0.12), "rods, legs of 2 to 8, 5 to 20; behind 3", noise=1),
    "rods-plain": Clip(partial(depth.make_rods, leaves=0.2, grain=0.02), "the same over almost flat ground", blur=0.5),
    # large surfaces
    "face": Clip(surfaces.make_face, "a face, up to 5, blinks", noise=1.5, blur=0.6),
    "cloth": Clip(surfaces.make_cloth, "cloth ripples, up to 5, lamps light up"),
    "handheld": Clip(partial(surfaces.make_handheld, reach=0.8), "a camera shakes, under 1", noise=1),
    "handheld-strong": Clip(partial(surfaces.make_handheld, reach=10), "a camera shakes, up to 10, with zoom and tilt"),
    # glass and gloss, focus, what whirls or enters
    "lenses": Clip(glass.make_lenses, "balls of glass, up to 18; behind 4", noise=1),
    "prism": Clip(glass.make_prism, "cut glass turns 9 and 15°; behind 3", blur=0.5),
    "tumblers": Clip(glass.make_tumblers, "drinking glasses, 7 to 20, enter and leave; behind -2"),
    "gloss": Clip(glass.make_gloss, "glossy balls spin, 7 and 11, what they mirror stays", noise=1),
    "defocus": Clip(glass.make_defocus, "sharp things, up to 13, before and behind soft ones, up to 42"),
    "vents": Clip(glass.make_vents, "a box with slots of period 6 turns 7°", noise=0.5),
    "blades": Clip(glass.make_blades, "blades turn 21 to 52° with motion blur; behind -5", subframes=9),
    "borders": Clip(glass.make_borders, "large things enter and leave, 15 to 45", noise=1, blur=0.5),
    "blind": Clip(glass.make_blind, "slats of period 16 sway, 5, in front of things, up to 18"),
    # what lies over it, and light
    "titles": Clip(surfaces.make_titles, "still logo and title, ticker -18; behind 9"),
    "reflection": Clip(surfaces.make_reflection, "behind glass 5, reflected -7", noise=1, blur=0.5),
    "dimming": Clip(surfaces.make_dimming, "pan 8, 6 % darker", noise=2),
    "sunrise": Clip(surfaces.make_sunrise, "zoom 1.5 %, pan -5, soft light wanders 14"),
}
