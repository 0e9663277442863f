"""Files of videos by the names that people and yt-dlp give them."""

from pathlib import Path

from kb.clips.clip_sources import video_files

IDS = ("9LTiW466lNx", "-_abcdefghi", "f7Ls9uxGu_x", "nEiYFJtc4Jx")


def test_every_form_of_name_is_found(tmp_path: Path) -> None:
    names = (
        "9LTiW466lNx.mp4",
        "deep/er/A [good] day [-_abcdefghi].WEBM",
        "f7Ls9uxGu_x/video.mkv",
        "9LTiW466lNx.json",
        "nEiYFJtc4Jx.mp4.part",
    )
    for name in names:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    found = {
        key: str(path.relative_to(tmp_path)) for key, path in video_files([tmp_path], IDS).items()
    }
    assert found == dict(zip(IDS, names[:3], strict=False))


def test_the_first_folder_counts(tmp_path: Path) -> None:
    for name in ("b", "a"):
        (tmp_path / name).mkdir()
        (tmp_path / name / f"{IDS[0]}.mp4").touch()
    found = video_files([tmp_path / "b", tmp_path / "a"], IDS)
    assert found == {IDS[0]: tmp_path / "b" / f"{IDS[0]}.mp4"}
