"""Files that cannot or may not be read: the sentence says why, and what to do; and no damage crashes or hangs."""

import json
import os
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from fpsboost import DecodeOptions, Encoding, InputError, Position, Trim, convert
from fpsboost.io.opening import open_source
from fpsboost.io.video.source import VideoSource
from fpsboost.media import clock, demuxer
from support.fuzzing import KINDS
from support.video_truth import add_pictures, copy_packets, pictures_of, read, write_clip

KEYS = {
    "encryption_scheme": "cenc-aes-ctr",
    "encryption_key": "76a6c65c5ea762046bd749a2e632ccbb",
    "encryption_kid": "a7e61c373e219033c21091fa607bf3b8",
}
FAST = Encoding(preset="ultrafast")


def write_encrypted_matroska(path: Path) -> Path:
    """A clip whose stream says that it is encrypted, in place of its title."""
    with av.open(str(path), "w") as output:
        stream, packets = add_pictures(output)
        stream.metadata["title"] = "x" * 40
        output.mux(packets)
    key = b"\x47\xe2\x84\x01\x02\x03\x04"  # of ContentEncKeyID; below, of ContentEncryption, its type, and its parents
    method = b"\x50\x35" + bytes([0x80 + len(key)]) + key
    entry = b"\x62\x40" + bytes([0x84 + len(method)]) + b"\x50\x33\x81\x01" + method
    whole = b"\x6d\x80" + bytes([0x80 + len(entry)]) + entry
    title = b"\x53\x6e\xa8" + b"x" * 40
    data = path.read_bytes()
    assert data.count(title) == 1
    void = b"\xec" + bytes([0x80 + len(title) - len(whole) - 2])
    path.write_bytes(data.replace(title, (whole + void).ljust(len(title), b"\0")))
    return path


@pytest.mark.parametrize("kind", ["mp4", "mov", "mkv"])
def test_an_encrypted_file_is_refused_before_work(tmp_path, kind):
    """Where its packets say so one by one, and where its stream does."""
    clip = tmp_path / f"in.{kind}"
    if kind == "mkv":
        write_encrypted_matroska(clip)
    else:
        copy_packets(write_clip(tmp_path / "clear.mkv", sound="aac"), clip, **KEYS)
    with pytest.raises(InputError, match=r"in\.\w+ is encrypted \(DRM\) and cannot be decoded; name a copy"):
        open_source(str(clip))


@pytest.mark.parametrize("suffix", [".mp4", ".mkv"])  # with an index, and surveyed
def test_what_is_clear_of_an_encrypted_file_is_converted_on_request(tmp_path, monkeypatch, suffix):
    """Up to the time that the refusal names; nothing else is written."""
    clip, output = write_clip(tmp_path / f"in{suffix}", times=range(20)), tmp_path / "out.mp4"
    for module in (clock, demuxer):
        monkeypatch.setattr(module, "is_encrypted", lambda packet: packet.pts * packet.time_base >= Fraction(2, 5))
    for end in (None, Position(Fraction(1, 2))):
        with pytest.raises(InputError, match=r"is encrypted \(DRM\) from 0\.4 s on; `end=0.4` converts"):
            convert(str(clip), str(output), method="nearest", decoding=DecodeOptions(Trim(end=end)), encoding=FAST)
        assert not output.exists()
    clear = DecodeOptions(Trim(end=Position(Fraction(2, 5))))
    summary = convert(str(clip), str(output), method="nearest", decoding=clear, encoding=FAST)
    assert len(pictures_of(output)) == 20
    assert not summary.remarks


def test_encrypted_sound_is_refused_and_can_be_left_out(tmp_path, monkeypatch):
    """Where the pictures are clear."""
    clip = write_clip(tmp_path / "in.mkv", sound="aac")
    monkeypatch.setattr("fpsboost.media.stream_copier.is_encrypted", lambda packet: packet.stream.type == "audio")
    with pytest.raises(
        InputError, match=r"in\.mkv has encrypted audio \(DRM\) in stream 1; leave it out with `audio=False`\."
    ):
        convert(str(clip), str(tmp_path / "out.mp4"), method="nearest", encoding=FAST)


@pytest.mark.parametrize("first", [0, 0.5])
def test_scrambled_packets_of_a_transport_stream_are_encrypted(tmp_path, first):
    """FFmpeg passes over them without a word, wholly or from somewhere on."""
    clip = write_clip(tmp_path / "in.ts", times=range(200), codec="mpeg2video")
    packets = np.frombuffer(clip.read_bytes(), np.uint8).reshape(-1, 188).copy()
    wanted = packets[int(first * len(packets)) :]
    hidden = (wanted[:, 1] % 32 == 1) & (wanted[:, 2] == 0)  # identifier 256
    wanted[hidden, 3] |= 0x80
    wanted[hidden, 12:] ^= 0x5A
    clip.write_bytes(packets.tobytes())
    with pytest.raises(InputError, match=r"is encrypted \(DRM\) and cannot be decoded"):
        VideoSource(clip)


@pytest.mark.parametrize(("old", "new"), [(b"avc1", b"drmi"), (b"mp4a", b"drms")])
def test_fairplay_is_encryption(tmp_path, old, new):
    """Of pictures, whose format FFmpeg does not know then, and of sound."""
    clip = write_clip(tmp_path / "in.mp4", sound="aac")
    data = new.join(clip.read_bytes().rsplit(old, 1)).split(b"\0\0\0\x14btrt")
    clip.write_bytes(b"\0\0\0\x0cfrma".join([data[0], *(old + b"\0\0\0\x08free" + rest[12:] for rest in data[1:])]))
    with pytest.raises(InputError, match=r"encrypted .*\(DRM\)" if new == b"drms" else r"is encrypted \(DRM\) and"):
        convert(str(clip), str(tmp_path / "out.mp4"), method="nearest", encoding=FAST)


def test_an_unfinished_file_is_refused_as_such(tmp_path):
    """MP4 that ends before its index, in the samples or after them, or has none, as DASH; what is no MP4 is damaged."""
    data = write_clip(tmp_path / "whole.mp4").read_bytes()
    end, clip = data.index(b"moov") - 4, tmp_path / "in.mp4"
    stream = copy_packets(tmp_path / "whole.mp4", tmp_path / "dash.mp4", movflags="frag_keyframe+empty_moov")
    segment = stream.read_bytes().partition(b"moof")[2]
    for rest, reason in (
        (data[: end - 100], "was never finished"),
        (data[:end], "untrunc"),
        (len(data).to_bytes(4) + b"moof" + segment, "put that before it"),
        (b"x" * 100, "damaged"),
    ):
        clip.write_bytes(rest)
        with pytest.raises(InputError, match=rf"in\.mp4 .*{reason}"):
            VideoSource(clip)


@pytest.mark.parametrize("name", ["in.m3u8", "in.mp4"])
def test_a_playlist_is_read_only_on_request(tmp_path, name):
    """One of HLS, and a script of FFmpeg's concat under another name, which both name a file elsewhere."""
    part, clip = write_clip(tmp_path / "part.ts", options={"preset": "ultrafast", "bf": "0"}), tmp_path / name
    head = "#EXTM3U\n#EXT-X-TARGETDURATION:2\n#EXTINF:1," if name == "in.m3u8" else "ffconcat version 1.0"
    clip.write_text(f"{head}\n{part.as_uri()}\n#EXT-X-ENDLIST\n" if name == "in.m3u8" else f"{head}\nfile part.ts\n")
    for decoder in ("ffmpeg", "opencv"):
        with pytest.raises(InputError, match=r"is a playlist, .* or pass `allow_playlists=True`\."):
            open_source(str(clip), decoding=DecodeOptions(decoder=decoder))
    allowed = DecodeOptions(allow_playlists=True)
    convert(str(clip), str(tmp_path / "out.mp4"), method="nearest", decoding=allowed, encoding=FAST)
    assert len(pictures_of(tmp_path / "out.mp4")) == 20


def test_an_encrypted_playlist_is_read_with_its_key(tmp_path):
    """Where the key is there, whatever its name; else a sentence says that it is missing, or a segment."""
    part, key, clip = write_clip(tmp_path / "part.ts"), tmp_path / "its.key", tmp_path / "in.m3u8"
    key.write_bytes(bytes(16))
    (tmp_path / "info").write_text(f"its.key\n{key}\n")
    copy_packets(part, clip, hls_key_info_file=str(tmp_path / "info"))
    decoding = DecodeOptions(allow_playlists=True)
    assert len(read(clip, decoding)[0]) == 10
    key.unlink()
    for text, reason in ((clip.read_text(), "the key where it says"), ("#EXTM3U\n#EXTINF:1,\nnone.ts\n", "are there")):
        clip.write_text(text)
        with pytest.raises(InputError, match=rf"in\.m3u8 is a playlist.*{reason}"):
            VideoSource(clip, decoding=decoding)


TESTS = Path(__file__).parents[1]
SEED = 20260
COPIES = 10


@pytest.mark.slow
@pytest.mark.parametrize("part", range(2))
def test_damaged_copies(tmp_path, part):
    """In a process of its own: every copy ends in an output that can be read or in a sentence that names a file."""
    kinds = KINDS[part::2]
    done = subprocess.run(
        [sys.executable, str(TESTS / "support" / "fuzzing.py"), str(tmp_path), str(SEED), str(COPIES), *kinds],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(TESTS), str(TESTS.parent)])},
        capture_output=True,
        timeout=110,
        check=False,
    )
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert done.returncode == 0, f"{lines[-1:]}\n{done.stderr.decode()[-4000:]}"
    outcomes = lines[1::2]
    assert len(outcomes) == COPIES * len(kinds)
    assert outcomes.count("converted") > len(kinds)
    refusals = [outcome for outcome in outcomes if outcome.startswith("refused: ")]
    assert len(refusals) + outcomes.count("converted") == len(outcomes)
    assert len(refusals) > len(kinds)
    assert all(outcome.endswith(".") and "\n" not in outcome and str(tmp_path) in outcome for outcome in refusals)
