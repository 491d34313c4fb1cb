"""An electro-hydraulic drive on a test bench, MBARI's power take-off: what does its plain model lack?"""
