"""What an outside audit of reliability and security found (November 2026), line by line, and the
tests that fail where it comes back.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

SWAP = "crash/test_swap_killed.py"
LINES = {
    "1 purge destroys good raw data": (
        "youtube/test_damage.py: purge_keeps_both_sides_of_a_damaged_frame",
        "store/tables/test_reading.py: a_purge_takes_no_damaged_table_for_an_empty_one",
    ),
    "2 crawl cuts committed data": (
        "youtube/test_damage.py: crawl_keeps_both_sides_of_a_damaged_frame_and_asks_again_for_it",
        "youtube/test_damage.py: only_a_torn_tail_that_the_state_does_not_know_is_cut",
    ),
    "3 purged text survives in leftovers": (
        "crash/test_purge_killed.py: nothing_is_left_of_what_was_purged",
        "store/test_leftovers.py: what_a_killed_query_spilled_goes_and_a_running_one_keeps_its_own",
        "crash/test_chaos.py: killed_and_run_again_it_is_as_if_nothing_had_been",
    ),
    "4 purge beside pairs or a first export": (
        "crash/test_two_at_once.py: the_second_names_the_first_and_nothing_comes_back",
    ),
    "5 no checksums": (
        "store/tables/test_parquet.py: of_2000_changed_bits_in_raw_and_parquet_none_is_silent",
        "store/tables/test_parquet.py: a_footer_is_told_by_itself",
        "query/test_execute.py: a_changed_bit_never_changes_an_answer",
        "reader/test_tables.py: a_changed_bit_is_told_by_rows_and_by_counts",
        "search/test_answers.py: a_damaged_index_is_told",
        "youtube/test_damage.py: a_flipped_bit_never_makes_another_answer",
    ),
    "6 a lost raw segment passes to the release": (
        "youtube/test_damage.py: what_a_deleted_or_cut_segment_held_is_asked_for_again",
        "youtube/test_damage.py: whoever_reads_raw_data_names_what_is_damaged",
    ),
    "7 a stopped demo rejects pages for good": (
        "wiki/connector/test_source.py: services_on_other_ports_are_the_same_wiki",
    ),
    "8 exports take no lock": (
        "crash/test_two_at_once.py: the_second_names_the_first_and_nothing_comes_back",
        "crash/test_chaos.py: joined_by_a_second_one_both_are_right",
    ),
    "9 a release folder vanishes silently": (
        "artifacts/test_manifest.py: a_missing_release_folder_is_never_passed_over",
        "artifacts/test_manifest.py: a_release_without_a_shard_is_refused",
        f"{SWAP}: what_was_killed_between_two_renames_is_healed_by_the_next_command",
    ),
    "10 a path in raw data leaves the root": (
        "wiki/test_export.py: no_path_in_data_leads_out_of_the_data_root",
        "reader/test_screenshots.py: no_path_in_data_leads_out_of_its_folder",
    ),
    "11 a changed picture under its old name": (
        "wiki/connector/test_source.py: lost_images_and_captures_are_asked_for_again",
        "wiki/connector/test_source.py: verify_finds_them_and_repair_has_them_again",
    ),
    "12 a checkpoint verified by its own name": (
        "annotate/test_checkpoint.py: a_files_own_name_proves_nothing",
        "annotate/test_checkpoint.py: what_a_verified_file_would_run_is_not_run",
    ),
    "13 Dask's dashboard on all interfaces": (
        "engine/test_dask.py: without_an_address_it_brings_its_own_cluster",
    ),
    "14 a lost or other reddit key": (
        "reddit/test_authors.py: no_other_key_takes_the_place_of_a_data_root_s",
    ),
    "15 a symlinked clean folder": ("artifacts/test_manifest.py: a_link_to_a_folder_stays_one",),
    "16 unexpected without a way out": (
        "annotate/test_damage.py: a_damaged_file_of_scores_is_named",
        "annotate/test_damage.py: too_little_memory_is_no_wrong_model",
        "store/state/test_json_files.py: a_damaged_note_is_named_with_what_to_do",
        "store/state/test_sqlite.py: a_malformed_state_is_named_with_what_to_do",
        "net/test_odd_answers.py: an_answer_nested_too_deep_is_one_line",
        "release/test_deposit.py: an_odd_answer_is_one_line_and_the_token_goes_nowhere",
        "core/test_profile.py: tables_nested_without_end_are_one_line",
    ),
    "17 terminal escapes from data": (
        "core/test_terminal.py: nothing_on_stderr_or_stdout_acts",
        "query/test_formats.py: nothing_of_the_data_acts_on_the_terminal",
    ),
    "leases and temporary files": (
        "crash/test_chaos.py: killed_and_run_again_it_is_as_if_nothing_had_been",
        "reddit/test_places.py: what_a_killed_import_left_is_noted_or_gone_before_a_purge",
        "store/test_leftovers.py: what_a_killed_release_left_beside_its_notes_goes",
    ),
    "a deleted table, and advice that is a command": (
        "artifacts/test_manifest.py: a_deleted_clean_file_or_table_is_one_line",
        "artifacts/test_manifest.py: pairs_that_lost_a_shard_are_made_again_as_the_line_says",
    ),
    "a second purge of the wiki by title": (
        "wiki/connector/test_source.py: purge_leaves_nothing",
        "reddit/test_refresh_purge.py: a_purge_that_was_cut_off_goes_on",
    ),
    "words of data in card and licence": (
        "release/test_release.py: words_of_the_data_are_never_markup_nor_lines",
    ),
    "STUN, redirects, plain http": (
        "wiki/browser/test_browser.py: a_page_reaches_no_stun_server",
        "net/test_redirects.py: a_service_that_leads_elsewhere_is_not_followed",
        "core/test_settings.py: a_wrong_value_is_named_and_not_shown",
    ),
    "dumps: a line without end, a repaired one": (
        "reddit/test_import.py: a_line_without_end_is_not_held_and_counts_as_damaged",
        "reddit/test_places.py: a_repaired_dump_of_the_same_size_and_beginning_is_read",
    ),
    "a state without permission": (
        "store/state/test_sqlite.py: a_state_that_may_not_be_opened_is_no_damaged_one",
    ),
    "the lock has no hashes": ("package/test_setup.py: every_file_of_the_lock_has_its_hash",),
}


@pytest.mark.parametrize("line", LINES)
def test_a_line_of_the_audit_has_its_tests(line: str) -> None:
    for named in LINES[line]:
        file, _, name = named.partition(": ")
        text = (ROOT / file).read_text(encoding="utf-8")
        assert re.search(rf"^def test_{name}\(", text, re.MULTILINE), named
