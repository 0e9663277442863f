"""Videos and what is said in them."""

import itertools

from tests.faults import Sandbox
from tests.sandbox.domains import of_case


def test_automatic_cues_overlap_and_manual_ones_do_not(services: Sandbox) -> None:
    world = services.world.youtube
    for name, overlap in (("asr", True), ("manual", False)):
        video = of_case(world, name)[0]
        cues = world.cues(video, video.tracks[0])
        assert (
            any(
                first[0] + first[1] > second[0] + 0.01 for first, second in itertools.pairwise(cues)
            )
            is overlap
        )
