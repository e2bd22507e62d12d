"""What a robot does next: vehicle prediction, candidates, objectives, single-robot and team planners.

Pure, as the estimator is: a planner sees one frozen `PlanProblem` and answers with one `Plan`.
"""
