"""The bad-data matrix: each row of trouble, and the tests that prove what becomes of it."""

from __future__ import annotations

ROWS: dict[int, tuple[str, tuple[str, ...]]] = {
    1: ("no number in PV", (
        "test_one_missing_pv",
        "test_a_hole_wider_than_three_periods_is_not_integrated_across",
        "test_a_bad_sample_is_counted_and_changes_nothing",
    )),
    2: ("no number in SP or OP only", (
        "test_only_the_set_point_or_only_the_output_is_missing",
    )),
    3: ("infinite, absurd, subnormal, negative zero", (
        "test_numbers_that_no_plant_has",
        "test_ten_ranges_outside_is_no_value",
        "test_numbers_at_the_edge_of_zero_are_values",
    )),
    4: ("a historian's words in place of a value", (
        "test_a_historians_words_in_place_of_a_value",
        "test_words_of_quality_are_kept",
        "test_text_in_a_value_is_a_missing_value",
    )),
    5: ("nothing but bad samples", (
        "test_nothing_but_bad_samples",
        "test_bad_for_a_while_is_said_once_and_once_when_it_ends",
        "test_bad_from_some_time_to_the_end_is_said_in_the_row",
        "test_bad_from_the_start_is_said_once",
    )),
    6: ("bad quality, plausible value", ("test_bad_quality_wins_over_a_plausible_value",)),
    7: ("uncertain quality", (
        "test_uncertain_samples_are_used_and_counted",
        "test_many_uncertain_samples_mark_the_index",
    )),
    8: ("no quality given", (
        "test_a_quality_that_is_not_given_counts_as_good_and_is_said",
    )),
    9: ("frozen PV, OP moves", (
        "test_a_frozen_pv_while_the_output_moves",
        "test_a_long_dead_time_at_the_start_is_no_frozen_pv",
    )),
    10: ("all constant", ("test_a_loop_at_rest_is_idle_and_not_stuck",)),
    11: ("values repeated by a gateway", (
        "test_a_gateway_that_repeats_its_last_values",
        "test_a_gateway_that_repeats_with_the_sources_own_time",
    )),
    12: ("silence", (
        "test_silence_of_one_loop_of_two",
        "test_silence_of_all_loops_is_one_event",
        "test_a_loop_that_falls_silent_for_good",
        "test_a_short_silence_at_the_end_of_a_file_is_none",
        "test_a_slow_loop_is_not_stale_between_its_samples",
    )),
    13: ("one sample missing", (
        "test_one_sample_is_missing",
        "test_one_missing_sample_is_bridged",
    )),
    14: ("5 % missing", ("test_a_twentieth_of_the_samples_is_missing",)),
    15: ("a gap of an hour", (
        "test_an_hour_is_missing_during_a_step",
        "test_an_hour_is_missing_at_rest",
    )),
    16: ("repeated", ("test_repeated_samples_change_nothing",)),
    17: ("same time, other value", (
        "test_other_values_at_the_same_time_are_a_conflict",
        "test_of_equal_times_the_first_is_kept",
    )),
    18: ("out of order within the window", (
        "test_out_of_order_within_the_window_is_sorted",
        "test_any_order_within_the_window_is_the_sorted_one",
        "test_a_fast_loop_has_the_room_that_its_window_needs",
    )),
    19: ("later than the window", (
        "test_a_backfill_is_late_and_turns_nothing_back",
        "test_what_comes_after_the_window_serves_the_audit_only",
        "test_a_replayed_batch_and_stragglers_are_late",
    )),
    20: ("files in reverse, or overlapping", ("test_files_in_reverse_or_overlapping",)),
    21: ("a clock ahead", (
        "test_a_clock_that_jumps_ahead",
        "test_a_clock_that_is_up_to_a_minute_ahead_is_believed",
    )),
    22: ("a clock set back", (
        "test_a_clock_that_is_set_back_an_hour",
        "test_a_clock_set_back_during_a_step_ends_its_event",
        "test_a_file_whose_clock_was_set_back",
        "test_a_clock_that_is_set_back_is_followed_after_a_while",
    )),
    23: ("the monitor's own clock steps", (
        "test_the_monitors_own_clock_does_not_matter_for_what_waits",
    )),
    24: ("change of the clocks in local time", (
        "test_local_times_across_a_change_of_the_clocks",
        "test_a_local_time_that_does_not_exist_names_its_line",
        "test_repeated_hour_is_told_apart_by_order",
    )),
    25: ("units of time", (
        "test_numeric_times_of_any_unit",
        "test_times_of_an_unclear_unit_are_refused",
        "test_a_gateways_zero_is_no_time",
    )),
    26: ("time without zone", ("test_a_time_without_zone_is_utc_and_it_is_said",)),
    27: ("jittered period", ("test_jittered_times",)),
    28: ("several periods, one that changes", (
        "test_every_loop_has_its_own_period",
        "test_a_period_that_changes_in_mid_stream",
    )),
    29: ("compressed PV", ("test_a_compressed_pv_is_marked",)),
    30: ("reported by exception", (
        "test_values_written_only_on_change_are_held",
        "test_a_pv_reported_by_exception",
    )),
    31: ("minute averages of a fast loop", ("test_minute_averages_of_a_fast_loop",)),
    32: ("coarse transmitter", ("test_a_coarse_transmitter",)),
    33: ("spike", ("test_a_spike_is_no_step",)),
    34: ("other units in mid-stream", ("test_other_units_in_mid_stream",)),
    35: ("another range", ("test_a_range_that_changes_holds_from_then_on",)),
    36: ("wrong tags", (
        "test_swapped_tags",
        "test_an_output_that_belongs_to_another_loop",
        "test_an_output_that_arrives_late_is_its_own",
    )),
    37: ("set point missing, ramping", (
        "test_a_set_point_that_moves_on_and_on_is_no_step",
        "test_a_set_point_that_is_missing_holds",
    )),
    38: ("manual by its tag", (
        "test_manual_by_its_tag",
        "test_an_event_ends_with_the_change_to_manual",
    )),
    39: ("manual without a tag", ("test_manual_without_a_tag",)),
    40: ("bumpless to automatic", ("test_back_to_automatic",)),
    41: ("to automatic with a bump", ("test_back_to_automatic",)),
    42: ("saturated", ("test_an_output_at_its_limit",)),
    43: ("sticking valve", ("test_a_sticking_valve",)),
    44: ("action and signs", ("test_reverse_and_direct_action",)),
    45: ("load step", ("test_a_load_step_is_no_set_point_step",)),
    46: ("overlapping steps", ("test_a_second_step_before_the_first_has_settled",)),
    47: ("step below the noise", (
        "test_a_step_below_the_noise_is_none",
        "test_noise_alone_opens_nothing",
    )),
    48: ("drift over months", ("test_a_drift_over_months_makes_no_series_of_alarms",)),
    49: ("constant or quiet at first", (
        "test_constant_at_first", "test_quiet_at_first",
    )),
    50: ("loops that come and go", (
        "test_loops_that_come_and_go",
        "test_a_name_that_comes_back_goes_on_behind_a_gap",
        "test_a_loop_of_no_table_is_given_up_after_a_month",
        "test_loops_added_later_leave_the_others_alone",
    )),
    51: ("damaged frames", (
        "test_damaged_frames", "test_frames_cut_anywhere",
        "test_one_bad_row_does_not_cost_the_frame",
        "test_a_column_of_another_type_refuses_the_frame",
        "test_what_cannot_be_read_is_counted_and_the_next_is_read",
    )),
    52: ("frames missing, repeated, begun anew", ("test_numbers_of_frames",)),
    53: ("burst", (
        "test_a_backlog_of_a_minute_in_one_go",
        "test_a_backlog_is_worked_off_in_pieces_without_loss",
    )),
    54: ("slow consumer", (
        "test_a_consumer_that_is_too_slow_loses_the_oldest_and_counts",
        "test_the_inbox_against_a_list",
        "test_a_tick_that_stalls_does_not_slow_the_publishers",
    )),
    55: ("killed", (
        "test_what_was_acknowledged_survives_a_kill",
        "test_killed_under_load_loses_nothing_that_was_said",
            "test_killed_in_mid_event_and_back_behind_a_gap",
            "test_killed_and_back_before_a_gap",
            "test_an_event_of_which_nothing_was_kept_is_interrupted",
            "test_a_damaged_file_is_left_alone",
    )),
    56: ("disk full, read-only", (
        "test_a_failing_disk_stops_nothing",
        "test_a_store_that_fails_for_ever_is_bounded",
        "test_a_read_only_or_full_file_is_an_error_and_recovers",
    )),
    57: ("damaged files, other dialects", (
        "test_a_csv_file_as_others_write_it",
        "test_a_torn_last_line_costs_itself",
        "test_damaged_files_beside_good_ones",
        "test_nothing_usable_is_exit_2",
        "test_embedded_nul_costs_its_cell_only",
        "test_flipped_bytes_never_crash",
        "test_damaged_files_are_left_out_and_the_rest_audited",
    )),
    58: ("files and frames that are made to harm", (
        "test_files_that_are_made_to_harm",
        "test_a_frame_that_decompresses_to_gigabytes_is_refused_unread",
        "test_declared_lengths_are_believed_only_within_bounds",
    )),
    59: ("hostile names", (
        "test_hostile_names_are_data_in_both_ways",
        "test_names_that_break_the_rules_are_refused_by_name",
        "test_names_register_encoded_or_are_refused",
        "test_hostile_names_pass_as_data",
    )),
    60: ("any workers, any order", (
        "test_any_order_of_rows_gives_the_same_bytes",
        "test_any_workers_and_any_order_of_tasks_give_the_same_bytes",
        "test_eight_workers_give_the_same_bytes",
        "test_jobs_change_nothing", "test_any_cut_into_tasks_gives_the_same",
    )),
    61: ("stream and batch", (
        "test_stream_and_batch", "test_live_over_zenoh_equals_batch",
    )),
    62: ("scale and offset", (
        "test_other_units_of_the_whole_record",
        "test_units_and_clock_do_not_matter",
    )),
    63: ("months", (
        "test_a_month", "test_a_month_of_a_thousand_loops",
    )),
    64: ("leap second, other years", (
        "test_other_years", "test_a_leap_second_is_refused_with_its_cause",
    )),
}  # fmt: skip
"""Number of the row: the trouble, and its tests. What does not concern operation alone holds in both ways in."""

INSTEAD: dict[int, str] = {
    5: (
        "A line of the log when a loop sends nothing but bad samples, one when it sends good ones again; a loop "
        "that has never sent a good one is named after 30 bad ones. Its row: not assessed, how many samples were "
        "bad, and the most frequent cause; where good ones came before, the flag `stale` and since when. These are "
        "no records: the contract's kinds of events are set-point and load steps."
    ),
    12: (
        "Live a loop is stale after three periods without a good sample, ten seconds at least (ten minutes while "
        "its period is not known). In the audit its last good sample must lie before the end of half of the loops "
        "by three periods, an hour and a hundredth of the whole time: an archive that writes what changes is silent "
        "for a while, and one loop that goes on alone makes no others stale. Both say the same in the row. All "
        "loops at once: one line, and `ready` is false in the status; there is no HTTP endpoint."
    ),
    19: (
        "Live a late sample is dropped and counted (`late`), and nowhere kept: the historian has it, and the audit "
        "puts it in its place."
    ),
    35: (
        "A range that changes holds from its settings message on. The audit knows one range for each loop: that of "
        "its table."
    ),
    41: (
        "As without a bump: a new start at the switch, whose transient falls into the warm-up, opens no event and "
        "is used by nothing. There is no record of the bump; the row's `manual` tells the time before it."
    ),
    48: (
        "Followed by the averages. There is no figure for the trend: with integral action PV does not drift, and "
        "OP's drift is the load's."
    ),
    50: (
        "The loop table is read at the start, so a change to it needs a restart, which begins anew. A loop that has "
        "registered itself is given up after 30 days without a good sample, those of the table never; one that is "
        "renamed is a new loop. Live only: the audit has an end."
    ),
    63: (
        "A thousand loops at a sample a minute (`-m soak`, ten minutes); more of them, or faster, have not been run "
        "for a month."
    ),
}
"""What holds where a row asks for more than is said, or for something else."""
