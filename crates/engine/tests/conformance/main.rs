//! What every backend must do: suites written once and run on each.
//!
//! A new backend is one descriptor in `support.rs` and two lines at the end of this file; a new law is covered by the
//! suites that go through the registry. What physics demands stands at the top of each suite and is the same for
//! all; bounds that rounding sets, and numbers of steps that a backend can afford, stand in its descriptor.

// Clippy's permission for tests does not reach their helpers.
#![allow(clippy::unwrap_used, clippy::panic)]

mod adhesion;
mod agreement;
mod bits;
mod bonds;
mod conservation;
mod convergence;
mod deforming;
mod energy;
mod exchange;
mod fields;
mod floor;
mod frames;
mod friction;
mod grades;
mod guards;
mod laws;
mod leaving;
mod packing;
mod pairwise;
mod periodic;
mod poses;
mod precision;
mod reach;
mod restitution;
mod round;
mod samples;
mod servo;
mod sizes;
mod springs;
mod support;
mod wear;

macro_rules! tests {
    ($subject:expr, $attributes:tt; $($file:ident::$test:ident),* $(,)?) => {
        $(test!($attributes $subject, $file, $test);)*
    };
}

macro_rules! test {
    ({$($attribute:tt)*} $subject:expr, $file:ident, $test:ident) => {
        $($attribute)*
        #[test]
        fn $test() {
            if let Some(subject) = $subject {
                crate::$file::$test(subject);
            }
        }
    };
}

/// The physics that any backend has to get right.
macro_rules! backend_suite {
    ($module:ident, $subject:expr, $slow:tt) => {
        mod $module {
            tests! { $subject, {};
                conservation::momentum_of_an_isolated_cloud,
                friction::a_spring_of_next_to_nothing_stays_finite,
                frames::a_boost_changes_nothing,
                frames::a_rotation_changes_nothing,
                frames::a_translation_changes_nothing,
                frames::a_sheared_cell_changes_nothing,
                floor::many_triangles_meet_at_a_point,
                floor::worlds_that_lack_room_at_once_keep_their_bits,
                floor::concave_corners_act_on_each_side,
                floor::a_plane_ends_where_it_ends,
                leaving::leavers_take_their_springs_along,
                leaving::trimmed_particles_take_their_springs_along,
                periodic::the_ledger_closes_through_seams,
                round::a_sphere_rests_on_cylinders_and_cones,
                round::ends_rims_and_seams,
                samples::stress_of_a_cubic_lattice,
                samples::stress_of_a_pair_through_seams,
                servo::a_governed_world_keeps_its_bits,
                deforming::a_lattice_follows_its_cell,
                deforming::a_deforming_world_keeps_its_bits,
                deforming::a_cell_that_leans_is_told_in_another,
                deforming::a_cell_that_leans_keeps_its_bits,
                precision::creep_is_not_lost,
                precision::resting_overlap,
                precision::a_packing_at_50_pa_stays_at_rest,
                energy::a_changing_stiffness_is_accounted,
                energy::surfaces_account_for_momentum_and_work,
                bits::runs_repeat,
                bits::a_glance_shows_the_particles,
                bits::a_world_alone_equals_itself_in_a_batch,
                bits::a_world_that_waits_ends_as_if_it_had_not,
                bits::a_surface_comes_and_goes_as_with_a_new_state,
                bits::a_checkpoint_goes_on,
                bits::leavers_are_listed,
                guards::a_world_that_goes_wrong_stops_alone,
                pairwise::a_pair_follows_its_own_laws,
                pairwise::a_device_refuses_more_than_two_laws_of_a_slot,
                exchange::what_comes_in_is_inside_or_went_out,
                exchange::what_leaves_comes_back,
                fields::a_sample_on_a_grid_is_the_sample,
                fields::a_column_carries_its_weight,
            }
            // Many laws, many steps, or kernels of their own, which take long to compile.
            tests! { $subject, $slow;
                laws::force_is_the_slope_of_energy,
                laws::contacts_of_normal_laws_are_born_without_memory,
                laws::contacts_of_tangential_laws_are_born_without_memory,
                laws::contacts_of_rolling_laws_are_born_without_memory,
                laws::contacts_of_cohesive_laws_are_born_without_memory,
                laws::contacts_of_normal_laws_that_turn_keep_their_force,
                laws::contacts_of_tangential_laws_that_turn_keep_their_force,
                laws::contacts_of_rolling_laws_that_turn_keep_their_force,
                laws::contacts_of_cohesive_laws_that_turn_keep_their_force,
                laws::normal_laws_do_not_give_energy,
                laws::tangential_laws_do_not_give_energy,
                laws::rolling_laws_do_not_give_energy,
                laws::cohesive_laws_do_not_give_energy,
                energy::an_elastic_gas_keeps_its_energy,
                friction::a_sphere_slides_until_it_rolls,
                deforming::moduli_of_a_packing,
                poses::a_table_of_a_steady_motion_is_that_motion,
                poses::a_table_of_an_oscillation_follows_it,
                round::a_sphere_swings_in_a_cylinder,
                round::a_turning_drum_drags,
                round::a_fine_mesh_acts_alike,
                samples::stress_of_a_gas,
                deforming::the_ledger_closes_in_a_deforming_cell,
                deforming::momentum_in_a_deforming_cell,
                deforming::stages_deform_one_after_the_other,
                deforming::a_cell_that_becomes_too_narrow_stops,
                deforming::a_sample_shears_without_end,
                servo::the_servo_reaches_a_stress_and_holds_it,
                servo::the_servo_reaches_a_shear_stress,
                servo::lateral_stress_is_held,
                servo::a_dense_sample_keeps_its_lateral_stress,
                periodic::a_blade_is_felt_however_far_it_goes,
                restitution::restitution_equals_e,
                friction::total_force_stays_below_the_cap,
                friction::a_block_slides_and_sticks,
                floor::a_floor_of_one_period_is_a_plane,
                floor::any_triangulation_is_one_plane,
                floor::a_convex_edge_acts_once,
                convergence::orders_of_the_integrators,
                energy::the_ledger_closes,
                friction::rolling_resistance_stops_a_sphere,
                reach::what_does_not_touch_does_not_press,
                sizes::a_grain_in_a_notch_rolls_out_of_it,
                adhesion::adhesion_holds_up_to_the_pull_off_force,
                adhesion::a_bridge_takes_its_energy_when_it_ruptures,
                adhesion::only_pairs_with_cohesion_stick,
                adhesion::plastic_contacts_lose_what_their_path_takes,
                adhesion::history_of_all_slots_survives_a_checkpoint,
                springs::a_rolling_spring_holds_a_sphere_on_a_slope,
                springs::twist_is_braked_and_held,
                pairwise::memories_of_different_laws_survive_a_checkpoint,
            }
        }
    };
}

/// Bonds between particles.
macro_rules! bonds_suite {
    ($module:ident, $subject:expr, $slow:tt) => {
        mod $module {
            tests! { $subject, {};
                bonds::broken_bonds_stay_broken_after_a_checkpoint,
                bonds::bonded_worlds_equal_themselves_in_a_batch,
                bonds::a_breaking_body_equals_the_reference,
            }
            // Kernels of their own, or many steps.
            tests! { $subject, $slow;
                bonds::a_cantilever_bends_as_its_bonds_say,
                bonds::bonds_break_at_their_strength,
                bonds::a_bonded_body_keeps_momentum_and_energy,
                bonds::bonds_are_made_by_pair_within_the_gap,
            }
        }
    };
}

/// Wear, which devices refuse.
macro_rules! wear_suite {
    ($module:ident, $subject:expr) => {
        mod $module {
            tests! { $subject, {};
                wear::a_sliding_sphere_wears_as_archard_says,
                wear::rolling_wears_nothing,
                wear::wear_is_told_and_kept,
                wear::a_cylinder_wears_under_the_sphere,
            }
        }
    };
}

/// What a backend has to have in common with the reference, and the bits that its threads may not change.
macro_rules! agreement_suite {
    ($module:ident, $subject:expr, $slow:tt) => {
        mod $module {
            tests! { $subject, {};
                agreement::short_trajectories_equal_the_reference,
                agreement::trajectories_with_rolling_springs_equal_the_reference,
                agreement::crowds_step_as_on_the_cpu,
                grades::wide_gradings_step_as_on_the_cpu,
                grades::graded_worlds_equal_themselves_in_a_batch,
                grades::gradings_feel_all_pairs,
                grades::searches_feel_all_pairs,
                grades::worlds_of_every_search_equal_themselves_in_a_batch,
                precision::forces_of_a_packing_at_50_pa_equal_the_reference,
                deforming::deforming_trajectories_equal_the_reference,
                bits::threads_change_no_bit,
            }
            tests! { $subject, $slow;
                agreement::one_step_forces_equal_the_reference,
                agreement::trajectories_with_all_memory_equal_the_reference,
                agreement::trajectories_with_laws_by_pair_equal_the_reference,
            }
        }
    };
}

backend_suite!(cpu, Some(&crate::support::CPU), {});
backend_suite!(reference, Some(&crate::support::REFERENCE), {});
bonds_suite!(bonds_on_cpu, Some(&crate::support::CPU), {});
bonds_suite!(bonds_on_reference, Some(&crate::support::REFERENCE), {});
wear_suite!(wear_on_cpu, Some(&crate::support::CPU));
wear_suite!(wear_on_reference, Some(&crate::support::REFERENCE));
agreement_suite!(cpu_against_reference, Some(&crate::support::CPU), {});
#[cfg(feature = "gpu")]
backend_suite!(gpu, crate::support::gpu(), { #[ignore = "minutes on a software device: for hardware, with --include-ignored"] });
#[cfg(feature = "gpu")]
bonds_suite!(bonds_on_gpu, crate::support::gpu(), { #[ignore = "minutes on a software device: for hardware, with --include-ignored"] });
#[cfg(feature = "gpu")]
agreement_suite!(gpu_against_reference, crate::support::gpu(), { #[ignore = "minutes on a software device: for hardware, with --include-ignored"] });
#[cfg(feature = "gpu")]
mod crowds_on_gpu {
    tests! { crate::support::crowds(), {};
        floor::many_triangles_meet_at_a_point,
        floor::concave_corners_act_on_each_side,
        agreement::short_trajectories_equal_the_reference,
        bits::a_world_alone_equals_itself_in_a_batch,
        bits::a_checkpoint_goes_on,
    }
    tests! { crate::support::crowds(), { #[ignore = "minutes on a software device: for hardware, with --include-ignored"] };
        floor::worlds_that_lack_room_at_once_keep_their_bits,
        floor::a_plane_ends_where_it_ends,
        floor::a_convex_edge_acts_once,
        floor::any_triangulation_is_one_plane,
    }
}
#[cfg(feature = "gpu")]
mod wear_on_gpu {
    tests! { crate::support::gpu(), {}; wear::a_device_refuses_wear }
}
