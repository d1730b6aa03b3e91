"""What the paper printed (Yan, Hsu & Wen, ION 2023), to be laid beside what comes out here."""

TABLE_1 = {"l_f": 1.75, "l_r": 1.2, "max_steering": 1.7, "max_acceleration": 4.5}
"""Key parameters: m, m, rad, m/s²."""

TABLE_2 = {
    "powertrain": {"a0": 143.20, "a1": 18.15, "a2": 1.0, "b0": 143.90, "b1": 2.21, "b2": 6.31e-2},
    "steering": {"a0": 1.70e-7, "a1": 25.44, "a2": 1.0, "b0": -0.49, "b1": 23.15, "b2": 0.47},
}
"""Parameters of the chosen order, P2Z2 for both."""

FIT = {"powertrain": {"fit": 88.9, "mse": 2.87e-3}}
"""FIT (percent) and MSE of that order where the text gives them."""

TABLE_3 = {
    "bend": {
        "VDM": {"max": 21.65, "mean": 8.27, "rmse": 10.53},
        "VDM-SI": {"max": 5.87, "mean": 2.44, "rmse": 2.94},
    },
    "s_curve": {
        "VDM": {"max": 8.35, "mean": 3.20, "rmse": 4.03},
        "VDM-SI": {"max": 1.30, "mean": 0.70, "rmse": 0.80},
    },
}
"""ATE, m. The improvements that it states follow from these numbers within their rounding."""
