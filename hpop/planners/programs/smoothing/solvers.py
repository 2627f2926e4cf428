"""Options of IPOPT for driven trajectories: first solutions, with and without second derivatives, and refined ones."""

from __future__ import annotations

from typing import Any

FLAT = "Solved_To_Acceptable_Level"  # the solver's word for an end in a flat valley
SUCCESS = ("Solve_Succeeded", FLAT)

OPTIONS: dict[str, Any] = {
    "print_time": False,
    "show_eval_warnings": False,  # where time is over, fields are not numbers
    "ipopt.print_level": 0,
    "ipopt.option_file_name": "",  # else one in the current folder counts, which may name a library to load
    "ipopt.sb": "yes",
    "ipopt.mu_init": 0.01,
    "ipopt.barrier_tol_factor": 100.0,  # the way to the last barrier need not be a central one
    "ipopt.max_iter": 150,
    "ipopt.mu_target": 3e-5,  # the last digits of a flat valley take a tenth of the time, for a thousandth of a cost
    "ipopt.tol": 3e-4,
    "ipopt.constr_viol_tol": 1e-3,  # what is left is settled in one step, after the solver
    # Or where the objective has not fallen by more than this in five steps: in a flat valley, or at a kink
    "ipopt.acceptable_obj_change_tol": 1e-4,
    "ipopt.acceptable_iter": 5,
    "ipopt.acceptable_tol": 1e-2,
    "ipopt.acceptable_constr_viol_tol": 1e-3,
    "no_nlp_grad": True,  # nobody asks how the optimum depends on parameters
    "calc_lam_p": False,
}

REFINING: dict[str, Any] = {
    **{
        f"ipopt.warm_start_{what}": 1e-6
        for what in ("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac")
    },
    "ipopt.warm_start_mult_bound_push": 1e-6,
    "ipopt.warm_start_init_point": "yes",
    "ipopt.mu_init": 1e-5,
    "ipopt.mu_target": 0.0,
    "ipopt.max_iter": 100,
    "ipopt.tol": 1e-4,
    "ipopt.constr_viol_tol": 1e-5,
    "ipopt.acceptable_obj_change_tol": 1e-5,
    "ipopt.acceptable_iter": 4,
    "ipopt.acceptable_tol": 1e-1,
}

QUASI_NEWTON: dict[str, Any] = {
    "ipopt.hessian_approximation": "limited-memory",
    "ipopt.max_iter": 300,
    "ipopt.tol": 1e-3,
    "ipopt.acceptable_obj_change_tol": 1e-3,
}

SORTS: dict[str, dict[str, Any]] = {
    "exact": {},  # second derivatives
    "quasi-newton": QUASI_NEWTON,  # learnt on the way: slower, but not misled by kinks of costs
    "refined": REFINING,  # from a solution, to more digits
}
