"""Analysis of a study: tables with intervals over participants, figures, a page, a notebook, power.

    from pointit import study_report

    trials = study_report.trials("my_study")
    study_report.medians(trials, "selection_s")

Functions return a `Table`, rows of which `pandas.DataFrame` makes a data frame. `study_report.figures` draws;
it needs the extra `plot`.
"""

from pointit.study_report.comparisons import differences as differences
from pointit.study_report.comparisons import learning as learning
from pointit.study_report.comparisons import medians as medians
from pointit.study_report.comparisons import mixed_model as mixed_model
from pointit.study_report.comparisons import names as names
from pointit.study_report.comparisons import outcomes as outcomes
from pointit.study_report.comparisons import participant_medians as participant_medians
from pointit.study_report.reading import Trials as Trials
from pointit.study_report.reading import trials as trials
from pointit.study_report.reading import write_all_trials as write_all_trials
from pointit.study_report.table import Table as Table
from pointit.study_report.table import questionnaires as questionnaires
from pointit.study_report.tapping_movements import fitts as fitts
from pointit.study_report.tapping_movements import omissions as omissions
from pointit.study_report.tapping_movements import throughput as throughput
