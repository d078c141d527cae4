"""What the study's command runs: simulated trials, and pictures of some of them."""

from drake_pregrasp.studies.static_versus_dynamic.experiment import Experiment
from drake_pregrasp.studies.static_versus_dynamic.figures import make_figures
from drake_pregrasp.studies.static_versus_dynamic.study_settings import study_settings
from drake_pregrasp.studies.static_versus_dynamic.trial import run_trial

EXPERIMENT = Experiment(run_trial, settings=study_settings(), make_figures=make_figures)
"""The trials, with their settings and figures."""
