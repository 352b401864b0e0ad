"""Analysis of frames around motion estimation: scene cuts, duplicate frames, illumination, overlays, grain.

Each module has one question about two or a few consecutive frames, and answers it with a frozen dataclass or a
function: `scene_cuts` where no motion connects a pair, `duplicates` which frames repeat a picture, `illumination` how
the light changes, `overlay` which pixels do not take part in the motion, `grain` how much noise interpolated frames
lack. `cadence` asks about a whole clip: which rate its pictures have.
"""
