// Loading an experiment: which, and with which numbers in place of the file's.
import { $, made, put } from "./dom.js";

let found = [];

export function showExperiments(list) {
  found = list;
  $("experiment").replaceChildren(...list.map((one) => new Option(one.name, one.name)));
  $("experiment").disabled = !list.length;
  showParameters();
}

const chosen = () => found.find((one) => one.name === $("experiment").value);

function showParameters() {
  const one = chosen();
  put($("experimentabout"), one ? [one.trajectory, one.controller && `led by ${one.controller}`].filter(Boolean).join(", ") : "none is for this robot");
  $("numbers").hidden = !(one && one.parameters.length);
  $("parameters").replaceChildren(...(one ? one.parameters : []).map((parameter) => {
    const input = parameter.choices
      ? made("select", {}, ...parameter.choices.map((choice) => new Option(choice, choice, false, choice === parameter.value)))
      : made("input", { type: "text", inputMode: "decimal", autocomplete: "off", spellcheck: false, value: written(parameter.value) });
    input.dataset.name = parameter.name;
    input.dataset.was = written(parameter.value);
    const words = parameter.name.replace(/_(mm|s|rad)$/, "").replaceAll("_", " ");
    const unit = (parameter.name.match(/_(mm|s|rad)$/) || ["", ""])[1];
    return made("label", {}, made("span", { textContent: unit ? `${words} / ${unit}` : words }), input);
  }));
}

const written = (value) => (Array.isArray(value) ? value.join(", ") : String(value));

// What was changed, as numbers; null where something is none, and the field says so.
export function changedParameters() {
  const changed = {};
  let wrong = null;
  for (const input of $("parameters").querySelectorAll("[data-name]")) {
    input.setCustomValidity("");
    if (input.value === input.dataset.was) continue;
    const parameter = chosen().parameters.find((one) => one.name === input.dataset.name);
    if (parameter.choices) { changed[parameter.name] = input.value; continue; }
    const numbers = input.value.split(",").map((word) => (word.trim() === "" ? NaN : Number(word)));
    const wanted = Array.isArray(parameter.value) ? parameter.value.length : 1;
    if (numbers.length !== wanted || !numbers.every(Number.isFinite)) {
      input.setCustomValidity(wanted === 1 ? "a number is wanted" : `${wanted} numbers with commas between them are wanted`);
      wrong = wrong || input;
    } else changed[parameter.name] = Array.isArray(parameter.value) ? numbers : numbers[0];
  }
  if (wrong) { wrong.reportValidity(); return null; }
  return changed;
}

$("experiment").addEventListener("change", showParameters);
