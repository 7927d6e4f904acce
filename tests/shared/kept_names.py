"""Names of functions that begin with no verb of the contributing page, and why they stay."""

from __future__ import annotations

# reason -> names
KEPT: dict[str, str] = {
    "commands, and what click prescribes": """
        app command follow_task get_command info invoke main modes parameters simulate_file warm
    """,
    "imported by pages, examples and plugins": """
        adapter assembled beside checks configurations described diagnose discover features_of load_tasks low_pass mimics
        missing_motion mixed name_words of_package offered passive_effort picture portrait printed_of_sdf prove ranges
        rotor_effort save schema series small torque_series turned undo_lag unique_names vector_series weights
        with_retardation with_stated
    """,
    "members that adapters and their readers offer": """
        abilities certify closing dynamics efforts export lifts replay unsupported version
    """,
    "members of a beam's law, as its users ask for them": """
        resultants tangent
    """,
    "methods that other libraries prescribe": """
        _compile_bytecode _optimize_final_module _optimize_functions _repr_html_ compile define_pipelines finalize generic_resolve
        get_call_template get_pointer_to_function on_broken_pipe repr_instance unify
    """,
    "public names": """
        all animate arc assert_same base_parameters distance factors follow frame from_samples from_urdf identify internal_frame
        differentiate_modes differentiate_residual_vibration
        differentiate joint_torques joints line linear_model lint load_cases load_mechanism merge meshed motor_side natural_modes
        nodal of
        plot point_to_point points refined shaped simulate stacked start statics steady_modes step summary tip_frame
        optimize_motion
        export_c export_fmu export_ros torque_derivatives torque_regressor torques turning verdict whole_frame with_body with_mesh
        wrench_frame
    """,
    "standard terms of mathematics and systems": """
        _cross _dot _eliminate_block _eliminate_column _exp_many _factorise_front _fork _log_many _reflect _series _sign
        _subtract_row _sweep block coefficients compose cos_sin cross cross_columns diagonal dot dot_pair eliminate escape exp
        exp_so3 exp_with factorise_blocks factorise_qr fetch force_cross fork from_quaternion inverse inverse_coefficient
        inverse_tangent inverse_transposed invert invert_scaled jit_formula jit_pass log log_so3 madd mat mat_at motion_cross
        mscale msub mul outer pair pair_at pause plus_cross plus_out_of predict put put_at put_block put_mat put_pair put_vec
        quadratic quiet row rows skew sub subtract subtract_four sum3 swap tangent3 tangent_with tapply tapply_pair times
        tmul transpose uninterrupted vec vec_at vec_of
    """,
    "what pytest prescribes": """
        pytest_addoption pytest_collect_file pytest_configure pytest_configure_node pytest_report_collectionfinish
        pytest_unconfigure reportinfo repr_failure runtest
    """,
}
NAMES = frozenset(name for names in KEPT.values() for name in names.split())
