"""The look of the page, beyond what the library gives."""

PRIMARY = "#0b62c4"
CSS = """
body { font-family: system-ui, sans-serif }
.nicegui-content { padding: 0; gap: 0 }
.wb-header { background: #10375c; padding: 6px 14px }
.wb-title { gap: 12px } .wb-errors { gap: 8px; opacity: 0.95; font-size: 13px; margin-left: 12px }
.wb-busy { font-size: 13px; max-width: 42vw; opacity: 0.9 }
.wb-tabs { border-bottom: 1px solid rgba(128,128,128,.25) } .wb-tabs .q-tab { min-height: 46px; padding: 0 14px }
.wb-tabs .q-tab__icon { font-size: 18px }
.wb-panels { background: transparent }
.wb-panels .q-tab-panel { padding: 16px 20px !important; max-width: 1340px; margin: 0 auto }
.wb-footer { background: #f2f5f8; color: #1b1f24; padding: 3px 14px; border-top: 1px solid rgba(128,128,128,.3) }
.body--dark .q-btn--flat, .body--dark .q-btn--outline, .body--dark a { --q-primary: #7ab7ff }
.body--dark .wb-paper { filter: invert(0.93) hue-rotate(180deg) }
.body--dark .wb-footer { background: #161b22; color: #c9d1d9 }
.wb-code, .wb-block { font: 12.5px/1.5 ui-monospace, monospace } .wb-code { max-width: calc(100vw - 110px) }
.wb-block { white-space: pre-wrap; overflow-wrap: anywhere; background: rgba(128,128,128,.1); padding: 6px 10px;
  border-radius: 6px; width: 100% }
.wb-quiet { color: #59636e; font-size: 13.5px } .body--dark .wb-quiet { color: #9aa4af }
.wb-matrix { border-collapse: separate; border-spacing: 2px; font-size: 13.5px }
.wb-matrix th { font-weight: 500; text-align: left; padding: 2px 8px; vertical-align: middle }
.wb-matrix td.cell { padding: 0 } .wb-matrix td.note { padding: 2px 8px; white-space: nowrap }
.wb-matrix button { width: 100%; min-width: 64px; padding: 5px 8px; border: 0; border-radius: 4px; cursor: pointer;
  font: inherit; text-align: right; font-variant-numeric: tabular-nums }
.wb-small { font-size: 13px; border-spacing: 1px } .wb-small th { padding: 1px 4px; max-width: 70px; line-height: 1.2 }
.wb-small tbody th { max-width: 96px; overflow-wrap: anywhere }
.wb-small button { min-width: 42px; padding: 4px }
.wb-matrix button.wb-worse { outline: 2px solid #de4a1c; outline-offset: -2px; font-weight: 600 }
.wb-plot { position: relative; scroll-margin-top: 64px } .wb-plot > [data-mark] { scroll-margin-top: 64px }
.wb-save { position: absolute; right: -6px; bottom: -2px; opacity: 0.75 }
.wb-band { max-width: 1340px; margin: 0 auto; padding: 12px 20px 0 }
.wb-said { text-align: left; cursor: pointer; background: none; border: 0; padding: 1px 0; font: inherit;
  color: inherit }
.wb-said:hover { text-decoration: underline; text-underline-offset: 3px }
.wb-matrix button:focus-visible, .wb-sentence:focus-visible, .wb-said:focus-visible {
  outline: 3px solid #6cb6ff; outline-offset: 1px }
.wb-scroll { overflow-x: auto; max-width: 100% }
.wb-sentence { text-align: left; cursor: pointer; text-decoration: underline;
  text-decoration-color: rgba(128,128,128,.6); text-underline-offset: 3px;
  background: none; border: 0; padding: 1px 0; font: inherit; color: inherit }
.wb-list { margin: 4px 0 4px 0; padding-left: 20px; list-style: disc } .wb-list li { margin: 3px 0 }
ol.wb-list { list-style: decimal } ol.wb-list li > * { vertical-align: top }
.wb-problems { min-width: min(640px, 92vw); max-width: 92vw } .wb-problems .wb-list { max-height: 60vh; overflow: auto }
.wb-card { border: 1px solid rgba(128,128,128,.35); border-radius: 10px; padding: 12px 14px; box-shadow: none; gap: 6px;
  background: transparent }
.wb-cards { display: grid;
  grid-template-columns: repeat(auto-fill, minmax(min(330px, 100%), 1fr)); gap: 12px; width: 100% }
.wb-two { display: grid; grid-template-columns: minmax(0, 1.25fr) minmax(0, 1fr); gap: 24px; width: 100% }
.wb-glance { grid-template-columns: minmax(0, 1.45fr) minmax(0, 1fr); row-gap: 10px }
.wb-split { display: grid; grid-template-columns: 300px minmax(0, 1fr); gap: 24px; width: 100% }
@media (max-width: 860px) { .wb-two, .wb-glance, .wb-split { grid-template-columns: minmax(0, 1fr) }
  .wb-tabs .q-tab { padding: 0 10px } .wb-tabs .q-tab__icon { display: none } .wb-tabs .q-tab { min-height: 38px }
  .wb-panels .q-tab-panel { padding: 10px !important } .wb-band { padding: 8px 10px 0 }
  .wb-paper { overflow-x: auto } .wb-paper svg { min-width: 620px }
  .wb-title { flex-wrap: wrap } .wb-errors { order: 9; width: 100%; margin-left: 0 } .wb-busy { max-width: 30vw } }
.wb-h { font-size: 16px; font-weight: 600; margin-top: 4px }
.wb-chip { font-size: 12px; border-radius: 10px; padding: 1px 9px; background: rgba(128,128,128,.18) }
.wb-good { background: rgba(26,127,75,.22) } .wb-bad { background: rgba(222,74,28,.22) }
.wb-table { border-collapse: collapse; font-size: 13.5px } .wb-table td, .wb-table th { padding: 3px 14px 3px 0;
  text-align: left; vertical-align: top } .wb-table th { font-weight: 600;
  border-bottom: 1px solid rgba(128,128,128,.5) }
.wb-fields td, [data-mark=mapper] td { vertical-align: middle }
.wb-fields .q-field { min-width: 96px; max-width: 150px }
.wb-fields .q-field__control { height: 30px; border-bottom: 1px solid rgba(128,128,128,.45) }
.wb-fields .q-field__native { font-size: 13.5px; padding: 0 }
.wb-table td.n, .wb-table th.n { text-align: right; font-variant-numeric: tabular-nums }
.wb-verdict { border-left: 5px solid #de4a1c; padding: 2px 0 2px 12px; font-size: 17px }
.wb-verdict.fine { border-color: #1a7f4b } .wb-verdict > :not(:first-child) { font-size: 14px }
.wb-grey { opacity: 0.62 }
.wb-notice { background: rgba(212,160,23,.2); border-bottom: 1px solid rgba(212,160,23,.6); padding: 6px 20px;
  gap: 2px }
.wb-ended { position: fixed; inset: auto 0 0 0; z-index: 9999; background: #10375c; color: #fff; padding: 14px 20px;
  font-size: 15px; line-height: 1.45 }
.wb-paper { background: #fff; border-radius: 10px; padding: 8px; max-width: 750px; width: 100% }
.wb-paper [data-part] { cursor: pointer } .wb-paper :is(line, path) { pointer-events: none }
.wb-wrap { min-width: 0; overflow-wrap: anywhere }
.wb-log { max-height: 230px; overflow: auto; font-size: 13px; width: 100% }
.wb-report { width: 100%; height: 75vh; border: 1px solid rgba(128,128,128,.35); border-radius: 8px; background: #fff }
.body--dark .wb-report { background: #121212 }
"""
